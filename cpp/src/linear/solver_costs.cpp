#include "sfmcpp/linear/solver_costs.hpp"

#include <algorithm>
#include <limits>
#include <map>
#include <mutex>

#include "aggregates.hpp"
#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/core/stopwatch.hpp"
#include "sfmcpp/linear/dense_cholesky.hpp"
#include "sfmcpp/linear/linear_solver.hpp"
#include "sfmcpp/linear/schur_kernels.hpp"

namespace sfmcpp::linear {
namespace {

constexpr double kNumber = sizeof(double);

// J, A|r and the indices of an observation.
double bytes_of_observation(const SolverCounts& counts) {
  return counts.number_bytes * (2 * counts.camera_size + 8) + 2 * sizeof(int);
}

// M, y, the sum and the shift of a point.
constexpr double kBytesOfPoint = sizeof(PointFactor) + 9 * kNumber;

// Schur–Jacobi and the vectors of conjugate gradients.
double bytes_of_camera(double camera_size) { return kNumber * camera_size * (camera_size + 16); }

}  // namespace

IterativeCounts count_from_jacobian(const SolverCounts& counts) {
  const double d = counts.camera_size;
  return {.iteration_bytes = 2 * counts.observations * bytes_of_observation(counts) +
                             counts.points * kBytesOfPoint + counts.cameras * bytes_of_camera(d),
          .kept_bytes = kNumber * (9 * counts.points + counts.cameras * 2 * d * d)};
}

// The coarse matrix and its factor, in blocks of the modes of an aggregate for each camera: 10.4 on
// a city of 3,000 cameras, 14 on one of 10,000.
constexpr double kCoarseBlocks = 14;

// With the preconditioner of clusters, in single precision and read twice by halves, and memory for
// the coarse space that may come in later.
IterativeCounts count_with_blocks(const SolverCounts& counts) {
  const double d = counts.camera_size;
  const double above = counts.blocks - counts.cameras;
  const double bytes = above * (sizeof(float) * d * d + sizeof(int));
  const double of_clusters = counts.cameras * kCamerasOfCluster * d * d * sizeof(float);
  const double of_coarse_space = counts.cameras * kNumber * kCoarseBlocks * (d + 1) * (d + 1);
  return {.iteration_bytes =
              bytes + of_clusters + counts.cameras * (kNumber * d * d + bytes_of_camera(d)),
          .kept_bytes = bytes + of_clusters + of_coarse_space +
                        kNumber * (6 * counts.points + counts.cameras * (2 * d * d + 18 * d))};
}

namespace {

// Steps that work done once is shared by: a run takes about so many. On the shapes of
// bench/choice.py the choices are the same for every number.
constexpr double kExpectedSteps = 10;
// Steps of conjugate gradients that are stopped early gain less. Where few iterations do, steps are
// as good as exact ones: up to 50 iterations as many came to 1e-3, from 60 on 1.3 to 1.7 times as
// many. So many for one exact step, where a step takes that many iterations or more; on the shapes
// of bench/choice.py with 1.25 or 1.75 one more choice is wrong.
constexpr double kInexactSteps = 1.5, kIterationsOfInexactSteps = 100;
double steps_for_an_exact_one(double iterations) {
  return 1.0 + (kInexactSteps - 1.0) * std::min(iterations / kIterationsOfInexactSteps, 1.0);
}
// Times that all threads meet in a step, whatever the solver, and in an iteration. Rates of regions
// are fitted to these amounts.
constexpr double kMeetingsOfStep = 20, kMeetingsOfIteration = 10;

double seconds_of(const Works& amounts, const Works& seconds_per_unit) {
  double seconds = 0.0;
  for (std::size_t k = 0; k < amounts.size(); ++k) seconds += amounts[k] * seconds_per_unit[k];
  return seconds;
}

double flops_of(const Works& amounts) {
  double flops = 0.0;
  for (const auto& row : EnumTraits<Work>::kTable) {
    if (is_flops(row.value)) flops += amount_of(amounts, row.value);
  }
  return flops;
}

double block_bytes(const SolverCounts& counts) {
  return kNumber * counts.blocks * counts.camera_size * counts.camera_size;
}

// Where every point is seen by a large part of the cameras, the diagonal blocks hold nearly all
// that S does, and few iterations do.
double iterations_of(const SolverCounts& counts) {
  if (counts.observations == 0.0 || counts.cameras == 0.0) return kFewestIterations;
  const double seen_by = 2 * counts.pairs / (counts.observations * counts.cameras);
  const double by_pairs = kExpectedIterations * (1 - seen_by) * (1 - seen_by);
  return std::max(kFewestIterations, std::min(by_pairs, counts.expected_iterations));
}

// Linearisation and the diagonal blocks, which every solver needs.
Works common_work(const SolverCounts& counts) {
  const double d = counts.camera_size;
  Works work{};
  // 4 d² for the block JᵀJ of the camera. All forecasts have this work in common.
  amount_of(work, Work::kObservations) = counts.observations * (4 * d * d + 20 * d + 200);
  amount_of(work, Work::kRegions) = kMeetingsOfStep;
  return work;
}

Works explicit_work(const SolverCounts& counts) {
  const double d = counts.camera_size;
  Works work = common_work(counts);
  // J_aᵀ (G_a G_bᵀ) J_b from the right: 12 products for the 2×2 matrix, 8 d flops for its product
  // with J_b, 4 d² for that with J_aᵀ.
  amount_of(work, Work::kPairs) = counts.pairs * (4 * d * d + 8 * d + 12);
  amount_of(work, Work::kBlocks) = block_bytes(counts);
  return work;
}

}  // namespace

bool is_flops(Work work) {
  switch (work) {
    case Work::kObservations:
    case Work::kPairs:
    case Work::kDenseFactor:
    case Work::kSparseFactor:
      return true;
    default:
      return false;
  }
}

void bound_sparse_factor(SolverCounts& counts) {
  if (counts.cameras == 0.0) return;
  // By cameras, as if each had one variable block.
  const double d = counts.columns / counts.cameras;
  const double below = std::max(counts.blocks - counts.cameras, 0.0);
  const double height = below / counts.cameras;
  counts.edges = below;
  counts.factor_flops = counts.cameras * d * d * d * (1.0 / 3 + height + height * height);
  counts.factor_entries = counts.cameras * d * d * (0.5 + height);
  counts.factor_bytes = kNumber * counts.factor_entries;
}

double SolverForecast::flops() const { return flops_of(step) + iterations * flops_of(iteration); }

double SolverForecast::seconds(const Works& seconds_per_unit) const {
  return seconds_of(step, seconds_per_unit) + iterations * seconds_of(iteration, seconds_per_unit);
}

double SolverForecast::seconds_to_compare(const Works& seconds_per_unit) const {
  const double steps =
      kind == LinearSolverKind::kIterative ? steps_for_an_exact_one(iterations) : 1.0;
  return steps * seconds(seconds_per_unit) + seconds_of(once, seconds_per_unit) / kExpectedSteps;
}

SolverForecast forecast_dense(const SolverCounts& counts) {
  const double n = counts.columns, matrix_bytes = kNumber * n * (n + kStrip) / 2;
  SolverForecast forecast{.kind = LinearSolverKind::kDense, .step = explicit_work(counts)};
  amount_of(forecast.step, Work::kDenseFactor) = n * n * n / 3;
  amount_of(forecast.step, Work::kDenseEntries) = matrix_bytes;
  forecast.bytes = matrix_bytes + counts.pair_list_bytes;
  return forecast;
}

SolverForecast forecast_sparse(const SolverCounts& counts) {
  SolverForecast forecast{.kind = LinearSolverKind::kSparse, .step = explicit_work(counts)};
  amount_of(forecast.once, Work::kSymbolic) = counts.edges;
  amount_of(forecast.step, Work::kSparseFactor) = counts.factor_flops;
  amount_of(forecast.step, Work::kSparseEntries) = counts.factor_bytes;
  // The factor takes the place of the matrix.
  forecast.bytes = counts.factor_bytes + 64 * counts.edges + counts.pair_list_bytes;
  return forecast;
}

SolverForecast forecast_iterative(const SolverCounts& counts, bool with_blocks) {
  const IterativeCounts iterative =
      with_blocks ? count_with_blocks(counts) : count_from_jacobian(counts);
  SolverForecast forecast{.kind = LinearSolverKind::kIterative,
                          .with_blocks = with_blocks,
                          .step = with_blocks ? explicit_work(counts) : common_work(counts)};
  amount_of(forecast.step, Work::kBlocks) /= 2;  // in single precision
  amount_of(forecast.iteration, with_blocks ? Work::kBlockProduct : Work::kProduct) =
      iterative.iteration_bytes;
  amount_of(forecast.iteration, Work::kRegions) = kMeetingsOfIteration;
  forecast.iterations = iterations_of(counts);
  forecast.bytes = iterative.kept_bytes + (with_blocks ? counts.pair_list_bytes : 0.0);
  return forecast;
}

const Works& reference_rates() {
  static constexpr Works kRates = {2.4e-11,   // observations
                                   1.45e-11,  // pairs
                                   2e-11,     // blocks
                                   6.6e-12,   // dense_factor
                                   6.2e-11,   // dense_entries
                                   1.35e-11,  // sparse_factor
                                   1.4e-10,   // sparse_entries
                                   1.5e-7,    // symbolic
                                   4.8e-11,   // product
                                   3.8e-11,   // block_product
                                   1.9e-6};   // regions
  return kRates;
}

namespace {

// What this machine does in a second, against the reference. The sizes are those that the reference
// was measured with.
constexpr int kRepeats = 3;
constexpr int kColumns = 480;
constexpr long kNumbers = 1 << 20;  // 8 MB, more than a core's own cache
constexpr long kPart = 1 << 14;

// Of the machine that the reference rates are of, as the measurements below have it.
constexpr double kReferenceFactorSeconds = 0.31e-3;
constexpr double kReferenceStreamSeconds = 0.16e-3;

// The shortest of a few, the first of which warms up.
template <class F>
double shortest_seconds(const F& f) {
  double shortest = std::numeric_limits<double>::infinity();
  for (int k = 0; k < kRepeats; ++k) {
    const Stopwatch watch;
    f();
    shortest = std::min(shortest, watch.seconds());
  }
  return shortest;
}

double factor_seconds(ThreadPool& pool) {
  DenseCholesky cholesky(kColumns);
  return shortest_seconds([&] {
    cholesky.set_zero(pool);
    for (int k = 0; k < kColumns; ++k) cholesky.at(k, k) = 1.0;
    cholesky.factorize(pool);
  });
}

double stream_seconds(ThreadPool& pool) {
  AlignedVector<double> from(kNumbers), to(kNumbers);
  std::fill(from.begin(), from.end(), 1.0);
  return shortest_seconds([&] {
    pool.parallel_for_parts(kNumbers, kPart, [&](long begin, long end) {
      std::copy(from.begin() + begin, from.begin() + end, to.begin() + begin);
    });
  });
}

struct Speed {
  double flops = 1.0, bytes = 1.0;  // seconds over those of the reference
};

Speed measured(ThreadPool& pool) {
  return {.flops = factor_seconds(pool) / kReferenceFactorSeconds,
          .bytes = stream_seconds(pool) / kReferenceStreamSeconds};
}

Speed speed_of_this_machine(ThreadPool& pool) {
  static std::mutex mutex;
  static std::map<int, Speed> known;
  const std::scoped_lock lock(mutex);
  const auto found = known.find(pool.num_threads());
  if (found != known.end()) return found->second;
  return known.emplace(pool.num_threads(), measured(pool)).first->second;
}

}  // namespace

Works rates_of_this_machine(ThreadPool& pool) {
  const Speed speed = speed_of_this_machine(pool);
  Works rates = reference_rates();
  for (const auto& row : EnumTraits<Work>::kTable)
    amount_of(rates, row.value) *= is_flops(row.value) ? speed.flops : speed.bytes;
  return rates;
}

}  // namespace sfmcpp::linear

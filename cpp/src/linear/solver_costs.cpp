#include "sfmcpp/linear/solver_costs.hpp"

#include <algorithm>

#include "sfmcpp/linear/iterative_counts.hpp"
#include "sfmcpp/linear/linear_solver.hpp"

namespace sfmcpp::linear {
namespace {

constexpr double kDouble = sizeof(double);
// Steps that work done once is shared by: a run takes about so many.
constexpr double kExpectedSteps = 10;
constexpr double kFewestIterations = 3;
// Steps of conjugate gradients that are stopped early gain less: so many for one exact step.
constexpr double kInexactSteps = 1.5;

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
  return kDouble * counts.blocks * counts.camera_size * counts.camera_size;
}

// Where every point is seen by a large part of the cameras, the diagonal blocks hold nearly all
// that S does, and few iterations do.
double iterations_of(const SolverCounts& counts, double of_large_scenes) {
  if (counts.observations == 0.0 || counts.cameras == 0.0) return kFewestIterations;
  const double seen_by = 2 * counts.pairs / (counts.observations * counts.cameras);
  return std::max(kFewestIterations, of_large_scenes * (1 - seen_by) * (1 - seen_by));
}

// Linearisation and the diagonal blocks, which every solver needs.
Works common_work(const SolverCounts& counts) {
  const double d = counts.camera_size;
  Works work{};
  amount_of(work, Work::kObservations) = counts.observations * (4 * d * d + 20 * d + 200);
  amount_of(work, Work::kRegions) = 20;
  return work;
}

Works explicit_work(const SolverCounts& counts) {
  const double d = counts.camera_size;
  Works work = common_work(counts);
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
  counts.factor_bytes = kDouble * counts.factor_entries;
}

double SolverForecast::flops() const { return flops_of(step) + iterations * flops_of(iteration); }

double SolverForecast::seconds(const Works& seconds_per_unit) const {
  return seconds_of(step, seconds_per_unit) + iterations * seconds_of(iteration, seconds_per_unit);
}

double SolverForecast::seconds_to_compare(const Works& seconds_per_unit) const {
  const double steps = kind == LinearSolverKind::kIterative ? kInexactSteps : 1.0;
  return steps * seconds(seconds_per_unit) + seconds_of(once, seconds_per_unit) / kExpectedSteps;
}

SolverForecast forecast_dense(const SolverCounts& counts) {
  const double n = counts.columns;
  SolverForecast forecast{.kind = LinearSolverKind::kDense, .step = explicit_work(counts)};
  amount_of(forecast.step, Work::kDenseFactor) = n * n * n / 3;
  amount_of(forecast.step, Work::kDenseEntries) = kDouble * n * n;
  amount_of(forecast.step, Work::kRegions) += n / 48;
  forecast.bytes = kDouble * n * n + counts.pair_list_bytes;
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
  amount_of(forecast.iteration, Work::kRegions) = 10;
  forecast.iterations = iterations_of(counts, kExpectedIterations);
  forecast.bytes = iterative.kept_bytes + (with_blocks ? counts.pair_list_bytes : 0.0);
  return forecast;
}

const Works& reference_rates() {
  static constexpr Works kRates = {
      2.4e-11, 1.45e-11, 2e-11, 6.6e-12, 6.2e-11, 2.7e-11, 2e-11, 1.5e-7, 4.8e-11, 3.8e-11, 1.9e-6};
  return kRates;
}

}  // namespace sfmcpp::linear

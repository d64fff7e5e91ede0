// What a step costs with each linear solver, predicted from counts before anything is done.
//
// Counts are of the problem alone. Rates turn them into seconds: fixed reference rates where a
// solver is chosen, so that the choice, and with it every bit of the result, is a function of the
// problem and the options; those of this machine where a person wants to know how long it takes.
#pragma once

#include <array>
#include <string_view>

#include "sfmcpp/core/enum_names.hpp"

namespace sfmcpp {

class ThreadPool;

namespace linear {

enum class LinearSolverKind;  // linear_solver.hpp

enum class Work {
  kObservations,
  kPairs,
  kBlocks,
  kDenseFactor,
  kDenseEntries,
  kSparseFactor,
  kSparseEntries,
  kSymbolic,
  kProduct,
  kBlockProduct,
  kRegions
};

}  // namespace linear

template <>
struct EnumTraits<linear::Work> {
  static constexpr std::string_view kWhat = "kind of work";
  static constexpr auto kTable = std::to_array<EnumRow<linear::Work>>(
      {{linear::Work::kObservations, "observations", "flops of linearising and of the diagonal"},
       {linear::Work::kPairs, "pairs", "flops of S, by pairs of observations of a point"},
       {linear::Work::kBlocks, "blocks", "bytes of S, put into the matrix of a solver"},
       {linear::Work::kDenseFactor, "dense_factor", "flops of a dense factorisation"},
       {linear::Work::kDenseEntries, "dense_entries", "bytes of a dense matrix"},
       {linear::Work::kSparseFactor, "sparse_factor", "flops of a sparse factorisation"},
       {linear::Work::kSparseEntries, "sparse_entries", "bytes of a sparse factor"},
       {linear::Work::kSymbolic, "symbolic", "coupled blocks to order and analyse, once"},
       {linear::Work::kProduct, "product", "bytes of a product with S from the Jacobian"},
       {linear::Work::kBlockProduct, "block_product", "bytes of a product with the blocks of S"},
       {linear::Work::kRegions, "regions", "times that all threads meet"}});
};

namespace linear {

// Whether an amount of this work is in flops; else it is in bytes, or in items.
bool is_flops(Work work);

// Amounts, or seconds a unit, of each kind of work.
using Works = std::array<double, EnumTraits<Work>::kTable.size()>;

inline double& amount_of(Works& works, Work work) { return works[static_cast<std::size_t>(work)]; }
inline double amount_of(const Works& works, Work work) {
  return works[static_cast<std::size_t>(work)];
}

// Iterations that a step is expected to take with clusters, before any has been taken; later those
// of the last steps are the better estimate (Iteration::linear_solver_iterations). The first three
// steps on a city of 3,000 cameras take 41 in the mean, the first four on one of 10,000 take 148,
// the first eight on 1,000 photos 49. Of 48 shapes of bench/choice.py 50 to 60 leave one more than
// 1.3 times behind the best (by noise), 40 two and 70 three.
inline constexpr double kExpectedIterations = 60;
// The fewest: where all cameras see all points; steps on the spheres of bench/choice.py take one to
// three.
inline constexpr double kFewestIterations = 3;

// Over the points of all ranks.
struct SolverCounts {
  double cameras = 0.0;
  double points = 0.0;
  double observations = 0.0;
  double pairs = 0.0;  // Σ n (n − 1) / 2 of the n observations of each point
  double camera_size = 0.0;
  double columns = 0.0;                  // of the reduced system
  double number_bytes = sizeof(double);  // of an entry of the Jacobian
  double pair_list_bytes = 0.0;          // schur_rows.hpp
  // What is known only of an analysed structure; the least that they can be where it is not.
  double blocks = 0.0;  // of S on and above the diagonal
  double edges = 0.0;   // coupled variable blocks
  double factor_flops = 0.0;
  double factor_entries = 0.0;
  double factor_bytes = 0.0;  // as stored
  // Of conjugate gradients in a step, at most; fewer where each point is seen by many cameras.
  double expected_iterations = kExpectedIterations;
};

// Sets the numbers of the sparse factor to bounds that no order of elimination is below: with E
// coupled blocks below the diagonal the columns of a factor have at least E in all, and the sum of
// their squares is least where all are alike.
void bound_sparse_factor(SolverCounts& counts);

// What the iterative solver does for a step, counted before it is done.
struct IterativeCounts {
  double iteration_bytes = 0.0;  // read and written
  double kept_bytes = 0.0;       // besides the normal equations
};

IterativeCounts count_from_jacobian(const SolverCounts& counts);
// With S in blocks.
IterativeCounts count_with_blocks(const SolverCounts& counts);

struct SolverForecast {
  LinearSolverKind kind{};
  bool with_blocks = false;  // of an iterative solver: with S in blocks
  Works once{};              // before the first step
  Works step{};              // every step
  Works iteration{};         // every iteration of an iterative solver
  double iterations = 0.0;   // expected in a step
  double bytes = 0.0;        // kept by the solver alone

  double flops() const;                                 // of a step
  double seconds(const Works& seconds_per_unit) const;  // of a step
  // Of as much progress as one exact step makes, with a share of the work that is done once.
  double seconds_to_compare(const Works& seconds_per_unit) const;
};

SolverForecast forecast_dense(const SolverCounts& counts);
SolverForecast forecast_sparse(const SolverCounts& counts);
// With S in blocks, or from the Jacobian alone.
SolverForecast forecast_iterative(const SolverCounts& counts, bool with_blocks);

// Seconds a unit on two threads of the machine that bench/choice.py was run on last, in the order
// of Work.
const Works& reference_rates();
// The same for this machine and the threads of a pool: by two measurements of a few milliseconds,
// made once in a process.
Works rates_of_this_machine(ThreadPool& pool);

}  // namespace linear
}  // namespace sfmcpp

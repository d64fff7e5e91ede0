#include <cstdio>
#include <unistd.h>

#include "iterative_solver.hpp"
#include "sfmcpp/linear/explicit_schur.hpp"
#include "sfmcpp/linear/iterative_counts.hpp"
#include "sfmcpp/linear/linear_solver.hpp"

namespace sfmcpp::linear {
namespace {

// Flops per second, in order of magnitude, on one core of today: only their ratios matter.
// Dense Cholesky, sparse supernodal, and passes bound by memory.
constexpr double kDenseRate = 30e9;
constexpr double kSparseRate = 8e9;
constexpr double kFormRate = 20e9;
constexpr double kIterativeRate = 4e9;
// Conjugate-gradient iterations a step is expected to take.
constexpr double kExpectedIterations = 60;
constexpr double kMemoryShare = 0.5;  // of the machine's memory that a matrix may take

struct Prediction {
  double seconds = 0.0;
  double bytes = 0.0;
};

double machine_bytes() {
  return static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGE_SIZE));
}

std::string describe(const char* name, const Prediction& p) {
  char text[96];
  std::snprintf(text, sizeof text, "%s %.2g ms and %.2g MB", name, 1e3 * p.seconds, p.bytes / 1e6);
  return text;
}

// Over the points of all ranks.
struct Counts {
  double observations = 0.0;
  double pair_updates = 0.0;
};

Counts count(const ObservationGraph& graph, Exchange& exchange) {
  double counts[] = {static_cast<double>(graph.num_observations()), num_pair_updates(graph)};
  exchange.sum(counts);
  return {counts[0], counts[1]};
}

// Explicit Schur complement without its factorisation.
Prediction predict_form(const Counts& counts, double size) {
  return {.seconds = 6 * size * size * counts.pair_updates / kFormRate,
          .bytes = counts.observations * 24 * size};
}

Prediction predict_iterative(const Counts& counts, double size) {
  return {.seconds = kExpectedIterations * counts.observations * (8 * size + 24) / kIterativeRate,
          .bytes = 0.0};
}

}  // namespace

LinearSolverChoice choose_linear_solver(const ObservationGraph& graph,
                                        const ParameterMap& map,
                                        const LinearSolverOptions& options,
                                        ThreadPool& pool,
                                        const CameraPairs& pairs,
                                        Exchange& exchange) {
  if (options.kind != LinearSolverKind::kAuto) return {options.kind, "as requested"};
  const double size = map.camera_size, columns = map.num_columns;
  const Counts counts = count(graph, exchange);
  const Prediction form = predict_form(counts, size);
  const Prediction iterative = predict_iterative(counts, size);
  const Prediction dense{form.seconds + columns * columns * columns / 3 / kDenseRate,
                         form.bytes + 8 * columns * columns};
  Prediction sparse{1e300, 1e300};
  // Below this the whole matrix costs less than analysing it.
  constexpr double kAlwaysDense = 300;
  const double budget = -exchange.max(-kMemoryShare * machine_bytes());  // of the smallest machine
  LinearSolverChoice choice{LinearSolverKind::kIterative, ""};
  if (columns > kAlwaysDense && form.bytes < budget && form.seconds < iterative.seconds * 100) {
    const auto structure = std::make_shared<ReducedStructure>(
        make_sparse_structure(make_global_camera_pattern(graph, pairs, pool, exchange), map));
    const auto blocks = static_cast<double>(structure->pattern.num_blocks());
    sparse = {form.seconds + structure->ordering.flops / kSparseRate,
              form.bytes + 8 * (size * size * blocks + structure->ordering.factor_entries)};
    choice.structure = structure;
  }
  double best = iterative.seconds;
  const auto consider = [&](LinearSolverKind kind, const Prediction& p) {
    if (p.seconds > best || p.bytes > budget) return;
    best = p.seconds;
    choice.kind = kind;
  };
  consider(LinearSolverKind::kSparse, sparse);
  consider(LinearSolverKind::kDense, dense);
  choice.reason = "predicted for a step: " + describe("dense", dense);
  if (sparse.seconds < 1e300) choice.reason += ", " + describe("sparse", sparse);
  choice.reason += ", " + describe("iterative", iterative);
  return choice;
}

namespace {

// Null where multiplying from the Jacobian costs less.
std::shared_ptr<const ReducedStructure> structure_worth_its_blocks(
    const NormalEquations& normal, std::shared_ptr<const ReducedStructure> structure) {
  const ObservationGraph& graph = normal.graph();
  if (normal.exchange().num_ranks() > 1 || graph.num_cameras == 0) return nullptr;
  IterativeSize size = iterative_size(graph, normal.map().camera_size);
  if (!structure) {
    size.blocks = graph.num_cameras;  // at least
    if (!blocks_pay(size)) return nullptr;
    structure = std::make_shared<ReducedStructure>(
        ReducedStructure{.pattern = make_camera_pattern(graph, {}, normal.pool())});
  }
  size.blocks = static_cast<double>(structure->pattern.num_blocks());
  return blocks_pay(size) ? structure : nullptr;
}

}  // namespace

std::unique_ptr<LinearSolver> make_linear_solver(
    const NormalEquations& normal,
    const LinearSolverOptions& options,
    std::shared_ptr<const ReducedStructure> structure) {
  if (options.kind == LinearSolverKind::kIterative) {
    return std::make_unique<IterativeSolver>(
        normal, options, structure_worth_its_blocks(normal, std::move(structure)));
  }
  return std::make_unique<ExplicitSchurSolver>(normal, options.kind, std::move(structure));
}

}  // namespace sfmcpp::linear

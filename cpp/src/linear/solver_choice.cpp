#include "solver_choice.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

#include "iterative_solver.hpp"
#include "sfmcpp/core/error.hpp"
#include "sfmcpp/core/machine.hpp"
#include "sfmcpp/linear/covisibility.hpp"
#include "sfmcpp/linear/explicit_schur.hpp"
#include "sfmcpp/linear/linear_solver.hpp"
#include "sfmcpp/linear/schur_rows.hpp"

namespace sfmcpp::linear {
namespace {

constexpr double kMemoryShare = 0.5;  // of the machine's memory that a matrix may take
// Iterations of a step times the gap (covisibility.hpp): on photo collections of 50 to 200 images
// steps take 7 to 9 and the gap is 0.3, on spheres 2 and 1.
constexpr double kIterationsTimesGap = 3;
// It is not computed for more observations, nor for a solver that at best costs that part of the
// others: it may take a tenth of a step.
constexpr double kMostObservations = 5e5;
constexpr double kWorthKnowing = 0.6;
constexpr int kManyIterations = 10'000;

// Of those that share a machine, this one included.
double ranks_of_this_machine(Exchange& exchange) {
  const double mine = machine_number();
  return static_cast<double>(std::ranges::count(exchange.gather({&mine, 1}), mine));
}

std::string in_words(double value, const char* unit) {
  char text[48];
  std::snprintf(text, sizeof text, "%.2g %s", value, unit);
  return text;
}

// Rounded up, so that a limit of that many is enough.
std::string needed(double bytes) {
  char text[48];
  std::snprintf(text, sizeof text, "%.1f MB", std::ceil(bytes / 1e5) / 10);
  return text;
}

std::string describe(const SolverForecast& forecast) {
  return std::string(enum_name(forecast.kind)) + (forecast.with_blocks ? " with blocks " : " ") +
         in_words(1e3 * forecast.seconds(reference_rates()), "ms") + " and " +
         in_words(forecast.bytes / 1e6, "MB");
}

[[noreturn]] void refuse_memory(double limit, const std::string& reason) {
  char text[48];
  std::snprintf(text, sizeof text, "%.12g", limit);
  throw InvalidArgument("max_memory_bytes = " + std::string(text) + ": " + reason);
}

[[noreturn]] void refuse(const LinearSolverOptions& options,
                         double held,
                         const SolverForecast& asked,
                         const SolverForecast& leanest) {
  std::string text;
  if (asked.kind != leanest.kind) {
    text += "the linear solver '" + std::string(enum_name(asked.kind)) + "' would need " +
            needed(held + asked.bytes) + ", and ";
  }
  text += "the leanest, '" + std::string(enum_name(leanest.kind)) + "', would need " +
          needed(held + leanest.bytes);
  refuse_memory(*options.max_memory_bytes, text);
}

// Compares the candidates, the cheap predictions first: the symbolic analysis that some of them
// need is made only while a lower bound of their cost could still win.
class Chooser {
 public:
  Chooser(const SolverQuestion& question, const LinearSolverOptions& options)
      : question_(question), options_(options), held_(question.exchange.max(question.held_bytes)) {
    choice_.counts = count(question);
    choice_.held_bytes = held_;
    choice_.budget_bytes = budget();
  }

  LinearSolverChoice choose() {
    if (options_.kind != LinearSolverKind::kAuto) return as_requested();
    consider(forecast_iterative(choice_.counts, false));
    consider(forecast_dense(choice_.counts));
    if (choice_.counts.columns > kAlwaysDense) {
      consider_blocks();
      consider_sparse();
    }
    if (cheapest().kind != LinearSolverKind::kIterative) reconsider_iterative();
    return choose_cheapest();
  }

 private:
  double budget() const {
    if (options_.max_memory_bytes) return *options_.max_memory_bytes - held_;
    // Of the smallest machine, by its ranks.
    const double share = kMemoryShare / ranks_of_this_machine(question_.exchange);
    return -question_.exchange.max(-share * memory_limit_bytes());
  }

  LinearSolverChoice as_requested() {
    if (options_.kind == LinearSolverKind::kIterative) consider_iterative();
    if (options_.kind == LinearSolverKind::kDense) consider(forecast_dense(choice_.counts));
    if (options_.kind == LinearSolverKind::kSparse) {
      analyse_structure(question_, choice_);
      consider(forecast_sparse(choice_.counts));
    }
    take_cheapest();
    choice_.reason = "as requested";
    return std::move(choice_);
  }

  // With blocks in any case where they fit and the preconditioner asked for is made of them.
  void consider_iterative() {
    if (needs_blocks(options_.preconditioner)) {
      find_blocks(question_, choice_);
      consider(forecast_iterative(choice_.counts, true));
      if (choice_.forecasts.back().bytes < choice_.budget_bytes) return;
      choice_.forecasts.clear();
    }
    consider(forecast_iterative(choice_.counts, false));
    consider_blocks();
  }

  void consider(const SolverForecast& forecast) { choice_.forecasts.push_back(forecast); }

  bool may_win(const SolverForecast& bound) const {
    return bound.bytes < choice_.budget_bytes &&
           std::ranges::all_of(choice_.forecasts, [&](const SolverForecast& other) {
             return other.bytes > choice_.budget_bytes ||
                    reference_seconds(bound) < reference_seconds(other);
           });
  }

  void consider_blocks() {
    if (!may_win(forecast_iterative(choice_.counts, true))) return;
    find_blocks(question_, choice_);
    const SolverForecast forecast = forecast_iterative(choice_.counts, true);
    if (may_win(forecast)) consider(forecast);
  }

  // From the Jacobian, or with as few blocks as there can be.
  int iterations_within_of_either(double seconds) const {
    return std::max(iterations_within(forecast_iterative(choice_.counts, false), seconds),
                    iterations_within(forecast_iterative(choice_.counts, true), seconds));
  }

  // Where all cameras hang together closely, it takes fewer iterations than on a road; how closely
  // is computed only where that may decide.
  void reconsider_iterative() {
    if (choice_.counts.observations > kMostObservations) return;
    const double seconds = reference_seconds(cheapest());
    if (iterations_within_of_either(kWorthKnowing * seconds) < kFewestIterations) return;
    const double most = iterations_within_of_either(seconds);
    const double gap = covisibility_gap(
        question_.graph, question_.pool, question_.exchange, kIterationsTimesGap / most);
    if (kIterationsTimesGap > most * gap) return;
    choice_.counts.expected_iterations = kIterationsTimesGap / gap;
    std::erase_if(choice_.forecasts, [](const SolverForecast& forecast) {
      return forecast.kind == LinearSolverKind::kIterative;
    });
    consider(forecast_iterative(choice_.counts, false));
    consider_blocks();
  }

  // First the blocks, then, if these leave a chance, an order of elimination.
  void consider_sparse() {
    if (!may_win(forecast_sparse(choice_.counts))) return;
    find_blocks(question_, choice_);
    if (!may_win(forecast_sparse(choice_.counts))) return;
    analyse_structure(question_, choice_);
    consider(forecast_sparse(choice_.counts));
  }

  // Of those that fit; the leanest if none does.
  const SolverForecast& cheapest() const {
    const auto fits = [&](const SolverForecast& f) { return f.bytes < choice_.budget_bytes; };
    const auto is_better = [&](const SolverForecast& a, const SolverForecast& b) {
      if (fits(a) != fits(b)) return fits(a);
      return fits(a) ? reference_seconds(a) < reference_seconds(b) : a.bytes < b.bytes;
    };
    return *std::ranges::min_element(choice_.forecasts, is_better);
  }

  // Of those considered, and those that need no analysis.
  SolverForecast leanest() const {
    std::vector<SolverForecast> known = choice_.forecasts;
    known.push_back(forecast_iterative(choice_.counts, false));
    known.push_back(forecast_dense(choice_.counts));
    return *std::ranges::min_element(known, {}, &SolverForecast::bytes);
  }

  void take_cheapest() {
    const SolverForecast& best = cheapest();
    if (options_.max_memory_bytes && best.bytes > choice_.budget_bytes)
      refuse(options_, held_, best, leanest());
    choice_.kind = best.kind;
    choice_.with_blocks = best.with_blocks;
  }

  LinearSolverChoice choose_cheapest() {
    take_cheapest();
    choice_.reason = "predicted for a step: ";
    for (const SolverForecast& candidate : choice_.forecasts)
      choice_.reason +=
          (&candidate == &choice_.forecasts.front() ? "" : ", ") + describe(candidate);
    return std::move(choice_);
  }

  const SolverQuestion& question_;
  const LinearSolverOptions& options_;
  double held_;
  LinearSolverChoice choice_;
};

}  // namespace

double reference_seconds(const SolverForecast& forecast) {
  return forecast.seconds_to_compare(reference_rates());
}

int iterations_within(SolverForecast iterative, double seconds) {
  int within = -1, beyond = kManyIterations;
  while (beyond - within > 1) {
    const int middle = (within + beyond) / 2;
    iterative.iterations = middle;
    (reference_seconds(iterative) <= seconds ? within : beyond) = middle;
  }
  return within;
}

SolverQuestion question_of(const NormalEquations& normal) {
  return {.graph = normal.graph(),
          .map = normal.map(),
          .pool = normal.pool(),
          .pairs = normal.camera_terms().pairs(),
          .exchange = normal.exchange()};
}

SolverCounts count(const SolverQuestion& question) {
  const ObservationGraph& graph = question.graph;
  double sums[] = {static_cast<double>(graph.num_points),
                   static_cast<double>(graph.num_observations()),
                   num_pair_updates(graph)};
  question.exchange.sum(sums);
  SolverCounts counts{
      .cameras = static_cast<double>(graph.num_cameras),
      .points = sums[0],
      .observations = sums[1],
      .pairs = sums[2] - sums[1],
      .camera_size = static_cast<double>(question.map.camera_size),
      .columns = static_cast<double>(question.map.num_columns),
      .number_bytes = question.number_bytes,
      .pair_list_bytes = pair_list_bytes(
          schur_kernels(question.map.camera_size, Precision::kDouble), sums[2] - sums[1], sums[1]),
      .blocks = static_cast<double>(graph.num_cameras)};
  bound_sparse_factor(counts);
  return counts;
}

void find_blocks(const SolverQuestion& question, LinearSolverChoice& choice) {
  if (choice.structure) return;
  choice.structure = std::make_shared<ReducedStructure>(
      ReducedStructure{.pattern = make_global_camera_pattern(
                           question.graph, question.pairs, question.pool, question.exchange)});
  choice.counts.blocks = static_cast<double>(choice.structure->pattern.num_blocks());
  bound_sparse_factor(choice.counts);
}

void analyse_structure(const SolverQuestion& question, LinearSolverChoice& choice) {
  find_blocks(question, choice);
  choice.structure = std::make_shared<ReducedStructure>(
      make_sparse_structure(choice.structure->pattern, question.map, question.pool));
  const BlockOrdering& ordering = choice.structure->ordering;
  choice.counts.edges = static_cast<double>(choice.structure->graph.edges.size());
  choice.counts.factor_flops = ordering.flops;
  choice.counts.factor_entries = ordering.factor_entries;
  choice.counts.factor_bytes = ordering.factor_bytes;
}

void require_memory(const LinearSolverOptions& options, double held_bytes, Exchange& exchange) {
  if (!options.max_memory_bytes) return;
  const double largest = exchange.max(held_bytes);
  if (largest > *options.max_memory_bytes)
    refuse_memory(*options.max_memory_bytes, "the solve would need " + needed(largest));
}

LinearSolverChoice choose_linear_solver(const SolverQuestion& question,
                                        const LinearSolverOptions& options) {
  return Chooser(question, options).choose();
}

std::unique_ptr<LinearSolver> make_linear_solver(
    const NormalEquations& normal,
    const LinearSolverOptions& options,
    std::shared_ptr<const ReducedStructure> structure) {
  if (options.kind == LinearSolverKind::kIterative) {
    return make_as_chosen(normal, options, choose_linear_solver(question_of(normal), options));
  }
  return std::make_unique<ExplicitSchurSolver>(normal, options.kind, std::move(structure));
}

std::unique_ptr<LinearSolver> make_as_chosen(const NormalEquations& normal,
                                             LinearSolverOptions options,
                                             const LinearSolverChoice& choice) {
  options.kind = choice.kind;
  if (choice.kind != LinearSolverKind::kIterative)
    return make_linear_solver(normal, options, choice.structure);
  return std::make_unique<IterativeSolver>(
      normal, options, choice.with_blocks ? choice.structure : nullptr);
}

}  // namespace sfmcpp::linear

// The options of a solve: a struct, and the one list of what each is called, means and may be.
// Checks, bindings, the keywords of Python's `solve` and the command line all come from the list.
#pragma once

#include <cmath>
#include <memory>
#include <optional>

#include "sfmcpp/ba/algebraic_cost.hpp"
#include "sfmcpp/ba/mask.hpp"
#include "sfmcpp/linear/linear_solver.hpp"
#include "sfmcpp/optim/options.hpp"
#include "sfmcpp/residuals/loss.hpp"

namespace sfmcpp::ba {

struct SolveOptions {
  optim::MinimizerOptions minimizer;
  linear::LinearSolverOptions linear_solver;
  LossKind loss = LossKind::kSquared;
  std::shared_ptr<const LossTable> loss_table{};  // in place of `loss`, which is then squared
  // Of the residual over σ, at least that of kAuto; none: from the median absolute residual at the
  // start.
  std::optional<double> loss_scale_px = 1.0;
  Gauge gauge = Gauge::kAuto;
  AlgebraicWeights algebraic_weights = AlgebraicWeights::kUniform;  // of the algebraic line search
  linear::Precision precision = linear::Precision::kAuto;
  int num_threads = 0;  // 0: as many as the machine has and the problem is worth

  bool is_robust() const { return loss_table || loss != LossKind::kSquared; }
  // Throws InvalidArgument listing every option out of its range.
  void validate() const;
};

// What a number must be.
struct Rule {
  bool (*holds)(double);
  const char* text;
};
inline constexpr Rule kAny{[](double) { return true; }, "a number"};
inline constexpr Rule kNotNegative{[](double x) { return x >= 0.0; }, "at least 0"};
inline constexpr Rule kAtLeastOne{[](double x) { return x >= 1.0; }, "at least 1"};
inline constexpr Rule kPositive{[](double x) { return x > 0.0; }, "positive"};
inline constexpr Rule kPositiveAndFinite{[](double x) { return x > 0.0 && std::isfinite(x); },
                                         "positive and finite"};
inline constexpr Rule kLossScale{is_loss_scale, kLossScaleRule};
inline constexpr Rule kShare{[](double x) { return x > 0.0 && x < 1.0; }, "in (0, 1)"};
inline constexpr Rule kNumThreads{[](double x) { return x >= 0.0 && x <= 1024.0; }, "in [0, 1024]"};

struct OptionFacts {
  const char* name;
  const char* description;
  Rule rule = kAny;
  const char* unit = nullptr;
  const char* unset = nullptr;  // what users say for no value; null: nothing, or None
};

// Calls f(facts, get) for each option; get(options) is a reference to the member.
//
// How to add an option: a member of the struct it belongs to, and its line here.
template <class F>
void for_each_option(const F& f) {  // NOLINT(readability-function-size): a table
  using O = OptionFacts;
  f(
      O{"method", "Minimiser"}, [](auto& o) -> auto& { return o.minimizer.method; });
  f(
      O{"line_search", "Line search along each step"},
      [](auto& o) -> auto& { return o.minimizer.line_search.kind; });
  f(
      O{"line_search_iterations",
        "Number of first iterations that use the line search",
        kNotNegative},
      [](auto& o) -> auto& { return o.minimizer.line_search.iterations; });
  f(
      O{"line_search_damping",
        "Also search in later iterations while λ is above this",
        kNotNegative},
      [](auto& o) -> auto& { return o.minimizer.line_search.damping_threshold; });
  f(
      O{"line_search_on_rejection",
        "Also search in later iterations where the unit step would be rejected"},
      [](auto& o) -> auto& { return o.minimizer.line_search.on_rejection; });
  f(
      O{"backtracking_test", "Acceptance test of the backtracking line search"},
      [](auto& o) -> auto& { return o.minimizer.line_search.backtracking_test; });
  f(
      O{"algebraic_weights", "Weights of observations in an algebraic line search"},
      [](auto& o) -> auto& { return o.algebraic_weights; });
  f(
      O{"acceleration", "Geodesic acceleration of steps by the curvature of the residuals"},
      [](auto& o) -> auto& { return o.minimizer.acceleration; });
  f(
      O{"point_steps", "Treatment of points that a step makes worse"},
      [](auto& o) -> auto& { return o.minimizer.point_steps; });
  f(
      O{"intrinsic_steps", "Treatment of intrinsics while poses are far off"},
      [](auto& o) -> auto& { return o.minimizer.intrinsic_steps; });
  f(
      O{"linear_solver", "Solver of the reduced camera system"},
      [](auto& o) -> auto& { return o.linear_solver.kind; });
  f(
      O{"precision", "Precision in which the Jacobian of the observations is stored"},
      [](auto& o) -> auto& { return o.precision; });
  f(
      O{"loss", "Robust loss"}, [](auto& o) -> auto& { return o.loss; });
  f(
      O{"loss_scale_px",
        "Residual over σ at which the loss leaves the parabola; the minimum if the loss is auto; "
        "auto: from the median absolute residual at the start",
        kLossScale,
        "pixels",
        "auto"},
      [](auto& o) -> auto& { return o.loss_scale_px; });
  f(
      O{"max_iterations", "Maximum number of steps, rejected ones included", kNotNegative},
      [](auto& o) -> auto& { return o.minimizer.termination.max_iterations; });
  f(
      O{"max_seconds", "Time limit", kPositive, "seconds"},
      [](auto& o) -> auto& { return o.minimizer.termination.max_seconds; });
  f(
      O{"function_tolerance",
        "Stop when an accepted step decreases the cost by less than this fraction",
        kNotNegative},
      [](auto& o) -> auto& { return o.minimizer.termination.function_tolerance; });
  f(
      O{"gradient_tolerance", "Stop when no entry of the gradient exceeds this", kNotNegative},
      [](auto& o) -> auto& { return o.minimizer.termination.gradient_tolerance; });
  f(
      O{"parameter_tolerance",
        "Stop when the step is shorter than this fraction of the norm of the unknowns",
        kNotNegative},
      [](auto& o) -> auto& { return o.minimizer.termination.parameter_tolerance; });
  f(
      O{"threads",
        "Number of threads, does not change the result; 0: by machine and problem size",
        kNumThreads},
      [](auto& o) -> auto& { return o.num_threads; });
  f(
      O{"gauge", "What fixes position, orientation and scale if nothing else does"},
      [](auto& o) -> auto& { return o.gauge; });
  f(
      O{"initial_damping", "Initial λ; default: that of the method", kPositiveAndFinite},
      [](auto& o) -> auto& { return o.minimizer.initial_damping; });
  f(
      O{"initial_radius",
        "Initial radius of the Dog-Leg; default: that of the method",
        kPositiveAndFinite},
      [](auto& o) -> auto& { return o.minimizer.initial_radius; });
  f(
      O{"damping_matrix", "Matrix that λ multiplies"},
      [](auto& o) -> auto& { return o.minimizer.damping_matrix; });
  f(
      O{"pcg_tolerance",
        "Relative residual at which the iterative linear solver stops; default: by pcg_forcing",
        kShare},
      [](auto& o) -> auto& { return o.linear_solver.pcg_tolerance; });
  f(
      O{"pcg_max_iterations", "Maximum iterations of the iterative linear solver", kAtLeastOne},
      [](auto& o) -> auto& { return o.linear_solver.pcg_max_iterations; });
  f(
      O{"pcg_forcing",
        "Without pcg_tolerance, the iterative linear solver stops at an iteration that gains less "
        "than this fraction of the average one",
        kShare},
      [](auto& o) -> auto& { return o.linear_solver.pcg_forcing; });
  f(
      O{"preconditioner", "Preconditioner of the iterative linear solver"},
      [](auto& o) -> auto& { return o.linear_solver.preconditioner; });
  f(
      O{"max_memory_bytes",
        "Memory limit of the solve beside the problem: another linear solver is chosen, or the "
        "problem is refused",
        kPositive,
        "bytes"},
      [](auto& o) -> auto& { return o.linear_solver.max_memory_bytes; });
}

}  // namespace sfmcpp::ba

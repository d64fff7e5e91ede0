#include <cmath>
#include <string>

#include "sfmcpp/ba/solve.hpp"
#include "sfmcpp/core/error.hpp"
#include "sfmcpp/core/options_check.hpp"

namespace sfmcpp::ba {
namespace {

using optim::Method;

void check_line_search(const optim::MinimizerOptions& minimizer, OptionsCheck& check) {
  const optim::LineSearchOptions& search = minimizer.line_search;
  check.require(search.iterations >= 0, "line_search_iterations", search.iterations, "at least 0");
  const double threshold = search.damping_threshold.value_or(1.0);
  check.require(threshold >= 0.0, "line_search_damping", threshold, "at least 0");
}

[[noreturn]] void refuse(const std::string& option, Method method, const char* reason) {
  throw InvalidArgument(option + " with method = '" + std::string(enum_name(method)) +
                        "': " + reason);
}

// An option that a method cannot heed is refused rather than ignored.
void refuse_what_does_not_combine(const SolveOptions& options) {
  const optim::MinimizerOptions& minimizer = options.minimizer;
  const Method method = minimizer.method;
  const optim::LineSearchOptions& search = minimizer.line_search;
  if (minimizer.initial_damping && !facts_of(method).has_damping)
    refuse("initial_damping", method, "it has no damping");
  if (minimizer.initial_radius && !facts_of(method).has_radius)
    refuse("initial_radius", method, "only 'dog-leg' has a radius");
  if (search.damping_threshold && !facts_of(method).has_damping)
    refuse("line_search_damping", method, "it has no damping to compare with");
  if (!facts_of(method).solves_linear_system &&
      options.linear_solver.kind != linear::LinearSolverKind::kAuto) {
    refuse("linear_solver = '" + std::string(enum_name(options.linear_solver.kind)) + "'",
           method,
           "it solves no linear system of all cameras; leave 'auto'");
  }
  if (search.kind == optim::LineSearchKind::kNone &&
      (search.damping_threshold || search.on_rejection)) {
    throw InvalidArgument(
        "line_search = 'none': choose a line search to be used " +
        std::string(search.on_rejection ? "on rejected steps" : "above line_search_damping"));
  }
}

}  // namespace

void SolveOptions::validate() const {
  OptionsCheck check;
  const optim::TerminationOptions& t = minimizer.termination;
  check.require(t.max_iterations >= 0, "max_iterations", t.max_iterations, "at least 0");
  check.require(t.max_seconds > 0.0, "max_seconds", t.max_seconds, "positive");
  check.require(
      t.function_tolerance >= 0.0, "function_tolerance", t.function_tolerance, "at least 0");
  check.require(
      t.gradient_tolerance >= 0.0, "gradient_tolerance", t.gradient_tolerance, "at least 0");
  check.require(
      t.parameter_tolerance >= 0.0, "parameter_tolerance", t.parameter_tolerance, "at least 0");
  const double damping = minimizer.initial_damping.value_or(1.0);
  check.require(
      damping > 0.0 && std::isfinite(damping), "initial_damping", damping, "positive and finite");
  const double radius = minimizer.initial_radius.value_or(1.0);
  check.require(
      radius > 0.0 && std::isfinite(radius), "initial_radius", radius, "positive and finite");
  check.require(loss_scale_px > 0.0 && std::isfinite(loss_scale_px),
                "loss_scale_px",
                loss_scale_px,
                "positive and finite");
  check.require(linear_solver.pcg_tolerance > 0.0 && linear_solver.pcg_tolerance < 1.0,
                "pcg_tolerance",
                linear_solver.pcg_tolerance,
                "in (0, 1)");
  check.require(linear_solver.pcg_max_iterations > 0,
                "pcg_max_iterations",
                linear_solver.pcg_max_iterations,
                "at least 1");
  check.require(num_threads >= 0 && num_threads <= 1024, "threads", num_threads, "in [0, 1024]");
  check_line_search(minimizer, check);
  check.done();
  refuse_what_does_not_combine(*this);
}

}  // namespace sfmcpp::ba

#include "sfmcpp/ba/solve_options.hpp"

#include <string>
#include <type_traits>

#include "sfmcpp/core/error.hpp"
#include "sfmcpp/core/options_check.hpp"

namespace sfmcpp::ba {
namespace {

using optim::Method;

// Of an option beside the value of another.
template <class E>
[[noreturn]] void refuse(const std::string& option, E other, const char* reason) {
  throw InvalidArgument(option + " with " + enum_setting(other) + ": " + reason);
}

void refuse_acceleration(const SolveOptions& options) {
  const optim::MinimizerOptions& minimizer = options.minimizer;
  const optim::Acceleration kind = minimizer.acceleration;
  if (kind == optim::Acceleration::kNone || kind == optim::Acceleration::kAuto) return;
  const std::string option = enum_setting(kind);
  if (!facts_of(minimizer.method).solves_damped_system())
    refuse(option, minimizer.method, "its step does not solve a damped system");
  if (minimizer.line_search.kind != optim::LineSearchKind::kNone)
    refuse(option, minimizer.line_search.kind, "a step is bent or searched along, not both");
  if (kind == optim::Acceleration::kGeodesic &&
      options.linear_solver.kind == linear::LinearSolverKind::kIterative)
    refuse(option,
           options.linear_solver.kind,
           "it keeps no factors to solve for the cameras again; choose 'points'");
}

void refuse_point_steps(const optim::MinimizerOptions& minimizer) {
  const optim::PointSteps wanted = minimizer.point_steps;
  if (wanted == optim::PointSteps::kAuto || wanted == optim::PointSteps::kWhole) return;
  const std::string option = enum_setting(wanted);
  if (!facts_of(minimizer.method).can_hold_back())
    refuse(option, minimizer.method, "it does not try another step");
  if (minimizer.line_search.kind != optim::LineSearchKind::kNone)
    refuse(option, minimizer.line_search.kind, "the search decides how far points go");
}

void refuse_intrinsic_steps(const optim::MinimizerOptions& minimizer) {
  if (minimizer.intrinsic_steps != optim::IntrinsicSteps::kLate) return;
  const std::string option = enum_setting(minimizer.intrinsic_steps);
  if (!facts_of(minimizer.method).solves_damped_system())
    refuse(option, minimizer.method, "its step does not solve a damped system");
  if (minimizer.line_search.kind != optim::LineSearchKind::kNone)
    refuse(option, minimizer.line_search.kind, "the search decides how far steps go");
}

bool is_algebraic(optim::LineSearchKind search) {
  return search == optim::LineSearchKind::kGlobalAlgebraic ||
         search == optim::LineSearchKind::kTwoWayAlgebraic;
}

// A comparison of tests or weights without the search that has them would compare nothing.
void refuse_parts_of_other_searches(const SolveOptions& options) {
  using optim::BacktrackingTest, optim::LineSearchKind;
  const optim::LineSearchOptions& search = options.minimizer.line_search;
  if (search.backtracking_test != BacktrackingTest::kArmijo &&
      search.kind != LineSearchKind::kBacktracking)
    refuse(enum_setting(search.backtracking_test), search.kind, "only 'backtracking' has a test");
  if (options.algebraic_weights != AlgebraicWeights::kUniform && !is_algebraic(search.kind))
    refuse(enum_setting(options.algebraic_weights),
           search.kind,
           "only 'g-als' and 't-als' have an algebraic cost");
}

void refuse_times_of_searches(const optim::MinimizerOptions& minimizer) {
  const optim::LineSearchOptions& search = minimizer.line_search;
  if (search.damping_threshold && !facts_of(minimizer.method).has_damping)
    refuse("line_search_damping", minimizer.method, "it has no damping to compare with");
  const bool on_condition = search.damping_threshold || search.on_rejection;
  if (search.kind != optim::LineSearchKind::kNone && search.iterations == 0 && !on_condition)
    refuse("line_search_iterations = 0",
           search.kind,
           "it would never search; choose line_search_on_rejection, line_search_damping or 'none'");
  if (search.kind == optim::LineSearchKind::kNone && on_condition) {
    throw InvalidArgument(
        "line_search = 'none': choose a line search to be used " +
        std::string(search.on_rejection ? "on rejected steps" : "above line_search_damping"));
  }
}

void refuse_damping(const optim::MinimizerOptions& minimizer) {
  const optim::MethodFacts& method = facts_of(minimizer.method);
  if (minimizer.initial_damping && !method.has_damping)
    refuse("initial_damping", minimizer.method, "it has no damping");
  if (minimizer.initial_radius && !method.has_radius)
    refuse("initial_radius", minimizer.method, "only 'dog-leg' has a radius");
  if (minimizer.damping_matrix != optim::MinimizerOptions{}.damping_matrix &&
      !method.has_damping_matrix)
    refuse(enum_setting(minimizer.damping_matrix), minimizer.method, "its step has no such matrix");
}

void refuse_linear_solver(const SolveOptions& options) {
  const linear::LinearSolverOptions& solver = options.linear_solver;
  const Method method = options.minimizer.method;
  if (!facts_of(method).solves_linear_system && solver.kind != linear::LinearSolverKind::kAuto)
    refuse(enum_setting(solver.kind),
           method,
           "it solves no linear system of all cameras; leave 'auto'");
  if (solver.pcg_tolerance && solver.pcg_forcing != linear::LinearSolverOptions{}.pcg_forcing)
    throw InvalidArgument("pcg_forcing with a pcg_tolerance, which takes its place");
}

void refuse_loss(const SolveOptions& options) {
  if (options.loss_table && options.loss != LossKind::kSquared) {
    throw InvalidArgument(enum_setting(options.loss) +
                          " with a loss_table, which takes its place: leave 'squared'");
  }
}

// A choice that cannot have an effect is refused rather than ignored. Numbers of a loss, a search
// or a linear solver may be given where another one is taken: who compares them keeps the numbers.
void refuse_what_does_not_combine(const SolveOptions& options) {
  refuse_damping(options.minimizer);
  refuse_acceleration(options);
  refuse_point_steps(options.minimizer);
  refuse_intrinsic_steps(options.minimizer);
  refuse_parts_of_other_searches(options);
  refuse_times_of_searches(options.minimizer);
  refuse_loss(options);
  refuse_linear_solver(options);
}

// The number an option holds, if it is one and set.
template <class T>
std::optional<double> numeric_value(const T& value) {
  if constexpr (std::is_enum_v<T>) {
    return std::nullopt;
  } else {
    return value;
  }
}

// A number that came from elsewhere need not be an enumerator.
template <class T>
void check_enumerator(const char* option, const T& value) {
  if constexpr (std::is_enum_v<T>) {
    if (is_enumerator(value)) return;
    throw InvalidArgument(std::string(option) + " = " + std::to_string(static_cast<int>(value)) +
                          ": is none of its values");
  }
}

}  // namespace

void SolveOptions::validate() const {
  OptionsCheck check;
  for_each_option([&](const OptionFacts& facts, const auto& get) {
    check_enumerator(facts.name, get(*this));
    const std::optional<double> value = numeric_value(get(*this));
    if (value) check.require(facts.rule.holds(*value), facts.name, *value, facts.rule.text);
  });
  check.done();
  refuse_what_does_not_combine(*this);
}

}  // namespace sfmcpp::ba

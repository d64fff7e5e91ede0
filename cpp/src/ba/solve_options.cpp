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

// A comparison of tests without the search that has them would compare nothing.
void refuse_backtracking_test(const optim::LineSearchOptions& search) {
  using optim::BacktrackingTest, optim::LineSearchKind;
  if (search.backtracking_test == BacktrackingTest::kArmijo ||
      search.kind == LineSearchKind::kBacktracking)
    return;
  refuse(enum_setting(search.backtracking_test), search.kind, "only 'backtracking' has a test");
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
  refuse_acceleration(options);
  refuse_point_steps(minimizer);
  refuse_intrinsic_steps(minimizer);
  refuse_backtracking_test(search);
  if (options.loss_table && options.loss != LossKind::kSquared) {
    throw InvalidArgument(enum_setting(options.loss) +
                          " with a loss_table, which takes its place: leave 'squared'");
  }
  if (search.damping_threshold && !facts_of(method).has_damping)
    refuse("line_search_damping", method, "it has no damping to compare with");
  if (!facts_of(method).solves_linear_system &&
      options.linear_solver.kind != linear::LinearSolverKind::kAuto) {
    refuse(enum_setting(options.linear_solver.kind),
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

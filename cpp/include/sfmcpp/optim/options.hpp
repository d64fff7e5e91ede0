#pragma once

#include <array>
#include <optional>
#include <string_view>

#include "sfmcpp/core/enum_names.hpp"
#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/optim/geodesic_acceleration.hpp"
#include "sfmcpp/optim/line_searches.hpp"
#include "sfmcpp/optim/methods.hpp"

namespace sfmcpp {

namespace optim {
// What is done about points that a step makes worse.
enum class PointSteps { kAuto, kWhole, kHeldBack, kRefitted };
enum class IntrinsicSteps { kAuto, kWhole, kLate };
}  // namespace optim

template <>
struct EnumTraits<optim::PointSteps> {
  using P = optim::PointSteps;
  static constexpr std::string_view kWhat = "point_steps";
  static constexpr auto kTable = std::to_array<EnumRow<P>>(
      {{P::kAuto, "auto", "refitted where the method can and no line is searched, else whole"},
       {P::kWhole, "whole", "all points as far as the step says"},
       {P::kHeldBack, "held-back", "points that spoil a step are drawn back along it"},
       {P::kRefitted,
        "refitted",
        "held-back, and points beyond the model of a step are fitted to the moved cameras"}});
};

template <>
struct EnumTraits<optim::IntrinsicSteps> {
  using I = optim::IntrinsicSteps;
  static constexpr std::string_view kWhat = "intrinsic_steps";
  static constexpr auto kTable = std::to_array<EnumRow<I>>(
      {{I::kAuto, "auto", "late where the method has damping and no line is searched, else whole"},
       {I::kWhole, "whole", "as far as the step says, from the first step on"},
       {I::kLate,
        "late",
        "held until the poses have settled, where the first steps would change focal lengths by "
        "more than 2 % and lead further down without"}});
};

template <>
struct EnumTraits<linear::DampingMatrix> {
  using D = linear::DampingMatrix;
  static constexpr std::string_view kWhat = "damping_matrix";
  static constexpr auto kTable =
      std::to_array<EnumRow<D>>({{D::kIdentity, "identity", "the identity"},
                                 {D::kDiagonal, "diagonal", "the diagonal of JᵀJ"}});
};

namespace optim {

// When to stop.
struct TerminationOptions {
  int max_iterations = 50;  // steps tried, rejected ones included
  std::optional<double> max_seconds;
  double function_tolerance = 1e-6;    // relative decrease of the cost by an accepted step
  double gradient_tolerance = 1e-10;   // largest entry of the gradient
  double parameter_tolerance = 1e-12;  // norm of the step, relative to that of the unknowns
};

// Which search, and at which iterations: the first ones, those whose λ is above a threshold, and
// those whose unit step would be rejected. Any of the three is enough (thesis §4.4.3.2).
struct LineSearchOptions {
  LineSearchKind kind = LineSearchKind::kNone;
  int iterations = 5;
  std::optional<double> damping_threshold;
  bool on_rejection = false;
  BacktrackingTest backtracking_test = BacktrackingTest::kArmijo;
};

struct MinimizerOptions {
  Method method = Method::kLevenbergMarquardtNielsen;
  std::optional<double> initial_damping;  // none: that of the rule
  std::optional<double> initial_radius;   // of the Dog-Leg; none: that of the method
  linear::DampingMatrix damping_matrix = linear::DampingMatrix::kDiagonal;
  LineSearchOptions line_search;
  Acceleration acceleration = Acceleration::kAuto;
  PointSteps point_steps = PointSteps::kAuto;
  IntrinsicSteps intrinsic_steps = IntrinsicSteps::kAuto;
  TerminationOptions termination;
};

// What becomes of points that a step makes worse: never kAuto.
inline PointSteps point_steps_of(const MinimizerOptions& options) {
  const bool searched = options.line_search.kind != LineSearchKind::kNone;
  if (searched || !facts_of(options.method).can_hold_back()) return PointSteps::kWhole;
  return options.point_steps == PointSteps::kAuto ? PointSteps::kRefitted : options.point_steps;
}

// Whether intrinsics may be held at first.
inline bool holds_intrinsics(const MinimizerOptions& options) {
  const bool searched = options.line_search.kind != LineSearchKind::kNone;
  return options.intrinsic_steps != IntrinsicSteps::kWhole && !searched &&
         facts_of(options.method).solves_damped_system();
}

}  // namespace optim
}  // namespace sfmcpp

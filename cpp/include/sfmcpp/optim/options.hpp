#pragma once

#include <array>
#include <limits>
#include <optional>
#include <string_view>
#include <utility>

#include "sfmcpp/core/enum_names.hpp"
#include "sfmcpp/linear/normal_equations.hpp"

namespace sfmcpp {

namespace optim {

enum class Method {
  kLevenbergMarquardt,
  kLevenbergMarquardtNielsen,
  kDogLeg,
  kGaussNewton,
  kGradientDescent,
  kConjugateGradient,
  kAlternation
};

enum class LineSearchKind {
  kNone,
  kGlobalAlgebraic,
  kTwoWayAlgebraic,
  kExact,
  kSoft,
  kBacktracking
};

// Sufficient decrease; with it the strong condition on the slope; or a decrease neither too small
// nor too close to the tangent's.
enum class BacktrackingTest { kArmijo, kStrongWolfe, kGoldstein };

}  // namespace optim

template <>
struct EnumNames<optim::Method> {
  static constexpr std::string_view kWhat = "method";
  static constexpr std::array<std::pair<optim::Method, std::string_view>, 7> kTable{
      {{optim::Method::kLevenbergMarquardt, "lm"},
       {optim::Method::kLevenbergMarquardtNielsen, "lm-nielsen"},
       {optim::Method::kDogLeg, "dog-leg"},
       {optim::Method::kGaussNewton, "gauss-newton"},
       {optim::Method::kGradientDescent, "gradient-descent"},
       {optim::Method::kConjugateGradient, "conjugate-gradient"},
       {optim::Method::kAlternation, "alternation"}}};
};

template <>
struct EnumNames<optim::LineSearchKind> {
  static constexpr std::string_view kWhat = "line_search";
  static constexpr std::array<std::pair<optim::LineSearchKind, std::string_view>, 6> kTable{
      {{optim::LineSearchKind::kNone, "none"},
       {optim::LineSearchKind::kGlobalAlgebraic, "g-als"},
       {optim::LineSearchKind::kTwoWayAlgebraic, "t-als"},
       {optim::LineSearchKind::kExact, "exact"},
       {optim::LineSearchKind::kSoft, "soft"},
       {optim::LineSearchKind::kBacktracking, "backtracking"}}};
};

template <>
struct EnumNames<optim::BacktrackingTest> {
  static constexpr std::string_view kWhat = "backtracking_test";
  static constexpr std::array<std::pair<optim::BacktrackingTest, std::string_view>, 3> kTable{
      {{optim::BacktrackingTest::kArmijo, "armijo"},
       {optim::BacktrackingTest::kStrongWolfe, "strong-wolfe"},
       {optim::BacktrackingTest::kGoldstein, "goldstein"}}};
};

template <>
struct EnumNames<linear::DampingMatrix> {
  static constexpr std::string_view kWhat = "damping_matrix";
  static constexpr std::array<std::pair<linear::DampingMatrix, std::string_view>, 2> kTable{
      {{linear::DampingMatrix::kDiagonal, "diagonal"},
       {linear::DampingMatrix::kIdentity, "identity"}}};
};

namespace optim {

// When to stop.
struct TerminationOptions {
  int max_iterations = 50;  // steps tried, rejected ones included
  double max_seconds = std::numeric_limits<double>::infinity();
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
  TerminationOptions termination;
};

}  // namespace optim
}  // namespace sfmcpp

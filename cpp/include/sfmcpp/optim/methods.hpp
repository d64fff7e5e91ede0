// The methods of minimisation, and all that is known of each, in one table.
//
// How to add a method: a class in a file of its own under src/optim (optim/step_strategy.hpp), an
// enumerator with its factory and its row here. Names, checks of options, Python and the command
// line come from the row.
#pragma once

#include <array>
#include <memory>
#include <string_view>

#include "sfmcpp/core/enum_names.hpp"

namespace sfmcpp {

namespace optim {

class StepStrategy;
struct MinimizerOptions;

enum class Method {
  kLevenbergMarquardt,
  kLevenbergMarquardtNielsen,
  kDogLeg,
  kGaussNewton,
  kGradientDescent,
  kConjugateGradient,
  kAlternation
};

using MethodFactory = std::unique_ptr<StepStrategy>(const MinimizerOptions& options);

// Levenberg–Marquardt with the rule of Hartley or of Nielsen (optim/damping_rule.hpp).
MethodFactory make_levenberg_marquardt;

MethodFactory make_gauss_newton;

// Along −D⁻¹∇F to the minimum of the quadratic model (thesis eq. 2.42 with its sign), shortened by
// halves when rejected.
MethodFactory make_gradient_descent;

// Nonlinear conjugate gradients, Polak–Ribière+, preconditioned by the diagonal blocks of JᵀJ
// (thesis §2.2.2.1).
MethodFactory make_conjugate_gradient;

// Powell's Dog-Leg with the radius rules of Lourakis & Argyros 2005 (thesis §2.2.2.4, eq. 2.43).
// Lengths are those of the damping matrix, ‖√D δ‖. The first radius is `initial_radius`, or 1 with
// D = I and ten Cauchy steps with D = diag(JᵀJ); the Gauss–Newton step is regularised by a λ of
// 1e-6. It does not limit the step: λ is reported as 0.
MethodFactory make_dog_leg;

// Resection, then intersection (thesis §3.2.4): a block Gauss–Seidel sweep over one linearisation,
// damped by Hartley's rule.
MethodFactory make_alternation;

struct MethodFacts {
  Method value;
  std::string_view name;
  std::string_view description;
  MethodFactory* make;
  bool has_damping = false;           // a λ that follows success and failure
  bool has_radius = false;            // of a trust region
  bool solves_linear_system = false;  // the normal equations as a whole
  bool shortens = true;               // rejections make its steps shorter and shorter
  bool keeps_directions = false;      // each step goes on from the last, with all its rounding
  bool has_damping_matrix = true;     // D, which λ multiplies or which measures lengths
  // Its step solves the damped system, so that a geodesic acceleration belongs to it, and some
  // unknowns may have more damping than others.
  constexpr bool solves_damped_system() const { return has_damping && solves_linear_system; }
  // Its next step can differ from a failed one, so that it is worth to save what can be saved of
  // it.
  constexpr bool can_hold_back() const { return solves_linear_system && shortens; }
  // Its system is singular while the gauge is free.
  constexpr bool needs_fixed_gauge() const { return solves_linear_system && !shortens; }
};

}  // namespace optim

template <>
struct EnumTraits<optim::Method> {
  using M = optim::Method;
  static constexpr std::string_view kWhat = "method";
  // clang-format off
  static constexpr auto kTable = std::to_array<optim::MethodFacts>({
      {.value = M::kLevenbergMarquardt, .name = "lm",
       .description = "Levenberg–Marquardt, λ by Hartley's rule",
       .make = optim::make_levenberg_marquardt, .has_damping = true, .solves_linear_system = true},
      {.value = M::kLevenbergMarquardtNielsen, .name = "lm-nielsen",
       .description = "Levenberg–Marquardt, λ by Nielsen's rule",
       .make = optim::make_levenberg_marquardt, .has_damping = true, .solves_linear_system = true},
      {.value = M::kDogLeg, .name = "dog-leg", .description = "Powell's Dog-Leg",
       .make = optim::make_dog_leg, .has_radius = true, .solves_linear_system = true},
      {.value = M::kGaussNewton, .name = "gauss-newton",
       .description = "Gauss–Newton, without damping",
       .make = optim::make_gauss_newton, .solves_linear_system = true, .shortens = false,
       .has_damping_matrix = false},
      {.value = M::kGradientDescent, .name = "gradient-descent", .description = "gradient descent",
       .make = optim::make_gradient_descent},
      {.value = M::kConjugateGradient, .name = "conjugate-gradient",
       .description = "nonlinear conjugate gradients with a block preconditioner",
       .make = optim::make_conjugate_gradient, .keeps_directions = true,
       .has_damping_matrix = false},
      {.value = M::kAlternation, .name = "alternation", .description = "resection, then intersection",
       .make = optim::make_alternation, .has_damping = true},
  });
  // clang-format on
};

}  // namespace sfmcpp

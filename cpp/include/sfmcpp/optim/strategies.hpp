// The step strategies; make_step_strategy chooses among them.
#pragma once

#include "sfmcpp/optim/step_strategy.hpp"

namespace sfmcpp::optim {

// Levenberg–Marquardt with the rule of Hartley or of Nielsen (optim/damping_rule.hpp).
std::unique_ptr<StepStrategy> make_levenberg_marquardt(const MinimizerOptions& options);

std::unique_ptr<StepStrategy> make_gauss_newton();

// Along −D⁻¹∇F to the minimum of the quadratic model (thesis eq. 2.42 with its sign), shortened by
// halves when rejected.
std::unique_ptr<StepStrategy> make_gradient_descent(const MinimizerOptions& options);

// Nonlinear conjugate gradients, Polak–Ribière+, preconditioned by the diagonal blocks of JᵀJ
// (thesis §2.2.2.1).
std::unique_ptr<StepStrategy> make_conjugate_gradient(const MinimizerOptions& options);

// Powell's Dog-Leg with the radius rules of Lourakis & Argyros 2005 (thesis §2.2.2.4, eq. 2.43).
// Lengths are those of the damping matrix, ‖√D δ‖. The first radius is `initial_radius`, or 1 with
// D = I and ten Cauchy steps with D = diag(JᵀJ); `initial_damping` is the little that regularises
// the Gauss–Newton step, 1e-6 where not given. It does not hold the step: λ is reported as 0.
std::unique_ptr<StepStrategy> make_dog_leg(const MinimizerOptions& options);

// Resection, then intersection (thesis §3.2.4): a block Gauss–Seidel sweep over one linearisation,
// damped by Hartley's rule.
std::unique_ptr<StepStrategy> make_alternation(const MinimizerOptions& options);

}  // namespace sfmcpp::optim

// Preconditioned conjugate gradients for a symmetric positive definite system.
#pragma once

#include <functional>
#include <vector>

#include "sfmcpp/core/parallel.hpp"

namespace sfmcpp::linear {

struct ConjugateGradientResult {
  int iterations = 0;
  double relative_residual = 0.0;
  bool finite = true;
};

using LinearMap = std::function<void(const std::vector<double>& in, std::vector<double>& out)>;

// Solves A x = b from x = 0 until ‖b − A x‖ ≤ tolerance ‖b‖ in the norm of the preconditioner's
// inverse, at most `max_iterations`, or until `should_stop`.
ConjugateGradientResult conjugate_gradient(ThreadPool& pool,
                                           const LinearMap& a,
                                           const LinearMap& preconditioner,
                                           const std::vector<double>& b,
                                           double tolerance,
                                           int max_iterations,
                                           const std::function<bool()>& should_stop,
                                           std::vector<double>& x);

}  // namespace sfmcpp::linear

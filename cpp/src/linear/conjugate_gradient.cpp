#include "sfmcpp/linear/conjugate_gradient.hpp"

#include <cmath>

#include "sfmcpp/linear/vector_algebra.hpp"

namespace sfmcpp::linear {
namespace {

constexpr int kIterationsBetweenStopChecks = 10;

}  // namespace

double ConjugateGradients::product(const std::vector<double>& u,
                                   const std::vector<double>& v) const {
  return exchange_.sum(dot(pool_, u, v));
}

ConjugateGradientResult ConjugateGradients::solve(const LinearMap& a,
                                                  const LinearMap& preconditioner,
                                                  const std::vector<double>& b,
                                                  const ConjugateGradientOptions& options,
                                                  const std::function<bool()>& should_stop,
                                                  std::vector<double>& x) {
  ConjugateGradientResult result;
  residual_ = b;
  z_.resize(b.size());
  a_direction_.resize(b.size());
  x.assign(b.size(), 0.0);
  preconditioner(residual_, z_);
  direction_ = z_;
  double rz = product(residual_, z_);
  const double target = options.tolerance * options.tolerance * rz;
  double decrease = 0.0;  // −Q of x
  while (!result.stopped && rz > target && result.iterations < options.max_iterations) {
    a(direction_, a_direction_);
    const double curvature = product(direction_, a_direction_);
    if (!(curvature > 0.0)) {
      // After some iterations this is rounding, and x is as accurate as it gets. In the first the
      // matrix is not positive definite.
      result.finite = result.iterations > 0;
      break;
    }
    const double alpha = rz / curvature;
    const double gain = 0.5 * alpha * rz;
    decrease += gain;
    add_scaled(pool_, alpha, direction_, x);
    add_scaled(pool_, -alpha, a_direction_, residual_);
    preconditioner(residual_, z_);
    const double next = product(residual_, z_);
    const double beta = next / rz;
    rz = next;
    scale_and_add(pool_, beta, z_, direction_);
    ++result.iterations;
    if (result.iterations * gain < options.forcing * decrease) break;
    result.stopped = result.iterations % kIterationsBetweenStopChecks == 0 && should_stop();
  }
  result.finite = result.finite && std::isfinite(rz);
  return result;
}

}  // namespace sfmcpp::linear

#include "sfmcpp/linear/conjugate_gradient.hpp"

#include <cmath>

#include "sfmcpp/linear/vector_algebra.hpp"

namespace sfmcpp::linear {
namespace {

constexpr int kIterationsBetweenStopChecks = 10;

}  // namespace

ConjugateGradientResult conjugate_gradient(ThreadPool& pool,
                                           const LinearMap& a,
                                           const LinearMap& preconditioner,
                                           const std::vector<double>& b,
                                           const ConjugateGradientOptions& options,
                                           const std::function<bool()>& should_stop,
                                           std::vector<double>& x,
                                           Exchange& exchange) {
  const auto product = [&](const std::vector<double>& u, const std::vector<double>& v) {
    return exchange.sum(dot(pool, u, v));
  };
  ConjugateGradientResult result;
  std::vector<double> residual = b, z(b.size()), direction, a_direction(b.size());
  x.assign(b.size(), 0.0);
  preconditioner(residual, z);
  direction = z;
  double rz = product(residual, z);
  const double target = options.tolerance * options.tolerance * rz;
  double decrease = 0.0;  // −Q of x
  while (!result.stopped && rz > target && result.iterations < options.max_iterations) {
    a(direction, a_direction);
    const double curvature = product(direction, a_direction);
    if (!(curvature > 0.0)) {
      // After some iterations this is rounding, and x is as accurate as it gets. In the first the
      // matrix is not positive definite.
      result.finite = result.iterations > 0;
      break;
    }
    const double alpha = rz / curvature;
    const double gain = 0.5 * alpha * rz;
    decrease += gain;
    add_scaled(pool, alpha, direction, x);
    add_scaled(pool, -alpha, a_direction, residual);
    preconditioner(residual, z);
    const double next = product(residual, z);
    const double beta = next / rz;
    rz = next;
    scale_and_add(pool, beta, z, direction);
    ++result.iterations;
    if (result.iterations * gain < options.forcing * decrease) break;
    result.stopped = result.iterations % kIterationsBetweenStopChecks == 0 && should_stop();
  }
  result.finite = result.finite && std::isfinite(rz);
  return result;
}

}  // namespace sfmcpp::linear

#include "sfmcpp/linear/conjugate_gradient.hpp"

#include <cmath>
#include <numeric>

namespace sfmcpp::linear {
namespace {

constexpr int kIterationsBetweenStopChecks = 10;

double dot(const std::vector<double>& a, const std::vector<double>& b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

// y ← y + s x
void add_scaled(double s, const std::vector<double>& x, std::vector<double>& y) {
  for (std::size_t k = 0; k < y.size(); ++k) y[k] += s * x[k];
}

}  // namespace

ConjugateGradientResult conjugate_gradient(const LinearMap& a,
                                           const LinearMap& preconditioner,
                                           const std::vector<double>& b,
                                           double tolerance,
                                           int max_iterations,
                                           const std::function<bool()>& should_stop,
                                           std::vector<double>& x) {
  ConjugateGradientResult result;
  std::vector<double> residual = b, z(b.size()), direction, a_direction(b.size());
  x.assign(b.size(), 0.0);
  preconditioner(residual, z);
  direction = z;
  double rz = dot(residual, z);
  const double target = tolerance * tolerance * rz;
  const double start = rz;
  while (rz > target && result.iterations < max_iterations) {
    a(direction, a_direction);
    const double curvature = dot(direction, a_direction);
    if (!(curvature > 0.0)) {
      // After some steps: rounding has used up what the matrix can tell. At once: it is not
      // definite.
      result.finite = result.iterations > 0;
      break;
    }
    const double alpha = rz / curvature;
    add_scaled(alpha, direction, x);
    add_scaled(-alpha, a_direction, residual);
    preconditioner(residual, z);
    const double next = dot(residual, z);
    const double beta = next / rz;
    rz = next;
    for (std::size_t k = 0; k < direction.size(); ++k) direction[k] = z[k] + beta * direction[k];
    ++result.iterations;
    if (result.iterations % kIterationsBetweenStopChecks == 0 && should_stop()) break;
  }
  result.finite = result.finite && std::isfinite(rz);
  result.relative_residual = start > 0.0 ? std::sqrt(rz / start) : 0.0;
  return result;
}

}  // namespace sfmcpp::linear

// Numeric Jacobians, the reference for analytic ones.
#pragma once

#include <cmath>

#include <Eigen/Core>

namespace sfmcpp {

// ∂f(δ)/∂δ at δ = 0, by central differences with one Richardson extrapolation: the error is of
// order step⁴. f maps a vector of `size` numbers to a vector.
template <class F>
Eigen::MatrixXd numeric_jacobian(const F& f, const Eigen::VectorXd& steps) {
  Eigen::MatrixXd jacobian;
  for (Eigen::Index k = 0; k < steps.size(); ++k) {
    const auto difference = [&](double step) -> Eigen::VectorXd {
      Eigen::VectorXd delta = Eigen::VectorXd::Zero(steps.size());
      delta[k] = step;
      const Eigen::VectorXd ahead = f(delta);
      delta[k] = -step;
      return (ahead - f(delta)) / (2.0 * step);
    };
    const Eigen::VectorXd column = (4.0 * difference(steps[k] / 2.0) - difference(steps[k])) / 3.0;
    if (jacobian.size() == 0) jacobian.resize(column.size(), steps.size());
    jacobian.col(k) = column;
  }
  return jacobian;
}

}  // namespace sfmcpp

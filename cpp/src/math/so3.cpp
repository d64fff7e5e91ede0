#include "sfmcpp/math/so3.hpp"

#include <cmath>

#include <Eigen/Geometry>
#include <Eigen/LU>

namespace sfmcpp {
namespace {

// Below this squared angle the series of sin(a)/a and (1 − cos a)/a² are exact to double precision
// after the terms kept here.
constexpr double kSmallSquaredAngle = 1e-4;

}  // namespace

bool is_rotation(const Eigen::Matrix3d& matrix, double tolerance) {
  const Eigen::Matrix3d excess = matrix * matrix.transpose() - Eigen::Matrix3d::Identity();
  return (excess.array().abs() <= tolerance).all() && matrix.determinant() > 0.0;
}

Eigen::Matrix3d exp_so3(const Eigen::Vector3d& w) {
  const double squared = w.squaredNorm();
  double sinc = 1.0 - squared / 6.0 * (1.0 - squared / 20.0 * (1.0 - squared / 42.0));
  double versine = 0.5 - squared / 24.0 * (1.0 - squared / 30.0 * (1.0 - squared / 56.0));
  if (squared > kSmallSquaredAngle) {
    const double angle = std::sqrt(squared);
    sinc = std::sin(angle) / angle;
    versine = (1.0 - std::cos(angle)) / squared;
  }
  const Eigen::Matrix3d k = skew(w);
  return Eigen::Matrix3d::Identity() + sinc * k + versine * k * k;
}

Eigen::Vector3d log_so3(const Eigen::Matrix3d& rotation) {
  // The quaternion is well conditioned at every angle, π included.
  Eigen::Quaterniond q(rotation);
  q.normalize();
  if (q.w() < 0.0) q.coeffs() = -q.coeffs();
  const double sine = q.vec().norm();
  const double scale = sine > 1e-8 ? 2.0 * std::atan2(sine, q.w()) / sine : 2.0 / q.w();
  return scale * q.vec();
}

// J = I + ½ [w]× + (1 − (a/2) cot(a/2)) / a² [w]×², a = ‖w‖ (Chirikjian, Stochastic Models,
// Information Theory, and Lie Groups, vol. 2, §10.8).
Eigen::Matrix3d inverse_right_jacobian_so3(const Eigen::Vector3d& w) {
  const double squared = w.squaredNorm();
  double quadratic = 1.0 / 12.0 * (1.0 + squared / 60.0 * (1.0 + squared / 42.0));
  if (squared > kSmallSquaredAngle) {
    const double half = 0.5 * std::sqrt(squared);
    quadratic = (1.0 - half / std::tan(half)) / squared;
  }
  const Eigen::Matrix3d k = skew(w);
  return Eigen::Matrix3d::Identity() + 0.5 * k + quadratic * k * k;
}

Eigen::Matrix3d orthonormalized(const Eigen::Matrix3d& m) {
  return 1.5 * m - 0.5 * m * m.transpose() * m;
}

}  // namespace sfmcpp

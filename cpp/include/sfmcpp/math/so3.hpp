// Rotations as 3×3 matrices and their tangent vectors [rad].
#pragma once

#include <Eigen/Core>

namespace sfmcpp {

inline Eigen::Matrix3d skew(const Eigen::Vector3d& w) {
  Eigen::Matrix3d m;
  m << 0, -w.z(), w.y(), w.z(), 0, -w.x(), -w.y(), w.x(), 0;
  return m;
}

// How far R Rᵀ of a given rotation may be from the identity, in each entry.
inline constexpr double kRotationTolerance = 1e-6;

// Orthonormal to the tolerance in each entry of R Rᵀ, and right-handed. False if not finite.
bool is_rotation(const Eigen::Matrix3d& matrix, double tolerance = kRotationTolerance);

// exp([w]×) by Rodrigues' formula; its Taylor series where the angle is small.
Eigen::Matrix3d exp_so3(const Eigen::Vector3d& w);

// The w of smallest norm with exp([w]×) = rotation; the norm is in [0, π].
Eigen::Vector3d log_so3(const Eigen::Matrix3d& rotation);

// The J with log(exp([w]×) exp([δ]×)) = w + J δ to first order; regular up to one turn.
Eigen::Matrix3d inverse_right_jacobian_so3(const Eigen::Vector3d& w);

// The rotation next to a matrix that is almost one (one polar Newton step; quadratic convergence).
Eigen::Matrix3d orthonormalized(const Eigen::Matrix3d& almost_rotation);

}  // namespace sfmcpp

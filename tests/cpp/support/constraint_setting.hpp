// A constraint between two poses, with its analytic and its numeric Jacobians.
#pragma once

#include <algorithm>
#include <array>
#include <random>
#include <vector>

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "sfmcpp/cameras/matrix34.hpp"
#include "sfmcpp/cameras/pose.hpp"
#include "sfmcpp/math/numeric_diff.hpp"
#include "sfmcpp/math/so3.hpp"
#include "sfmcpp/residuals/pose_constraints.hpp"

namespace sfmcpp::support {

using PoseNumbers = std::array<double, 12>;

constexpr std::array<residuals::ConstraintKind, 11> kKindsOnPoses{
    residuals::ConstraintKind::kPose,
    residuals::ConstraintKind::kPosition,
    residuals::ConstraintKind::kOrientation,
    residuals::ConstraintKind::kOrientationReprojections,
    residuals::ConstraintKind::kDisplacementPose,
    residuals::ConstraintKind::kDisplacementTranslation,
    residuals::ConstraintKind::kDisplacementRotation,
    residuals::ConstraintKind::kDisplacementRotationLog,
    residuals::ConstraintKind::kScale,
    residuals::ConstraintKind::kSmoothing,
    residuals::ConstraintKind::kSmoothingReprojections};

using RowMajor6 = Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::RowMajor>;

inline Eigen::Matrix4d matrix_of(const PoseNumbers& pose) {
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  m.topRows<3>() = PoseMatrixView(pose.data());
  return m;
}

inline PoseNumbers pose_of(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& centre) {
  PoseNumbers pose;
  Eigen::Map<PoseMatrix> m(pose.data());
  m << rotation, centre;
  return pose;
}

// Two poses that look along z, a measurement that fits neither, and points before all cameras.
struct ConstraintSetting {
  explicit ConstraintSetting(residuals::ConstraintKind kind, unsigned seed = 1) : random(seed) {
    pose = pose_of(exp_so3(vector(0.3)), vector(1.0));
    previous = pose_of(exp_so3(vector(0.3)), vector(1.0));
    for (int j = 0; j < 7; ++j) {
      const Eigen::Vector3d x = vector(2.0) + Eigen::Vector3d(0, 0, 12);
      points.insert(points.end(), {x[0], x[1], x[2]});
    }
    constraint = {.kind = kind,
                  .rotation = exp_so3(vector(0.3)),
                  .translation = vector(1.0),
                  .distance = 0.7,
                  .points = points,
                  .intrinsics = {400.0, 1.1, 310.0, 250.0, 3.0}};
  }

  Eigen::Vector3d vector(double size) {
    return Eigen::Vector3d::NullaryExpr([&] { return size * uniform(random); });
  }

  Eigen::VectorXd residual() const { return residual_at(pose, previous); }
  Eigen::VectorXd residual_at(const PoseNumbers& p, const PoseNumbers& q) const {
    Eigen::VectorXd e(residuals::residual_size(constraint));
    residuals::evaluate(constraint, p.data(), q.data(), {e.data()});
    return e;
  }

  std::mt19937 random;
  std::uniform_real_distribution<double> uniform{-1.0, 1.0};
  PoseNumbers pose, previous;
  std::vector<double> points;
  residuals::PoseConstraint constraint;
};

struct Jacobians {
  Eigen::MatrixXd by_pose, by_previous;
};

inline Jacobians analytic(const ConstraintSetting& s) {
  const int size = residuals::residual_size(s.constraint);
  Eigen::VectorXd e(size);
  RowMajor6 by_pose(size, 6), by_previous(size, 6);
  residuals::evaluate(s.constraint,
                      s.pose.data(),
                      s.previous.data(),
                      {e.data(), by_pose.data(), by_previous.data()});
  return {by_pose, by_previous};
}

inline PoseNumbers displaced(const PoseNumbers& pose, const Eigen::VectorXd& delta) {
  PoseNumbers result;
  plus_pose(pose.data(), delta.data(), result.data());
  return result;
}

inline Jacobians numeric(const ConstraintSetting& s, double step = 1e-3) {
  const Eigen::VectorXd steps = Eigen::VectorXd::Constant(6, step);
  const auto by_pose = [&](const Eigen::VectorXd& d) {
    return s.residual_at(displaced(s.pose, d), s.previous);
  };
  const auto by_previous = [&](const Eigen::VectorXd& d) {
    return s.residual_at(s.pose, displaced(s.previous, d));
  };
  return {numeric_jacobian(by_pose, steps), numeric_jacobian(by_previous, steps)};
}

inline void expect_close(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b, double tolerance) {
  const double scale = std::max(1.0, b.cwiseAbs().maxCoeff());
  EXPECT_LT((a - b).cwiseAbs().maxCoeff(), tolerance * scale) << a << "\n\n" << b;
}

}  // namespace sfmcpp::support

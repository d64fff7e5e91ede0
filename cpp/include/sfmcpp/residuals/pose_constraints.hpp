// One constraint, evaluated: what was measured, the residual e and its Jacobians
// (residuals/constraint_kinds.hpp has the equations).
//
// Jacobians are by the tangents of note §2: R ← R exp([δR]×), t ← t + δt; columns (δR, δt).
#pragma once

#include <array>
#include <span>
#include <string>

#include <Eigen/Core>

#include "sfmcpp/residuals/constraint_kinds.hpp"

namespace sfmcpp::residuals {

// What was measured; a kind reads the parts that its equation names. The frozen points of the
// reprojection forms are the caller's and must be in front of both cameras.
struct PoseConstraint {
  ConstraintKind kind = ConstraintKind::kPosition;
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();     // R̂
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();      // t̂
  double distance = 0.0;                                      // ŝ
  std::span<const double> points;                             // Q: N × 3, world
  std::array<double, 5> intrinsics{1.0, 1.0, 0.0, 0.0, 0.0};  // f, aspect, cx, cy, skew of π
};

// Where an evaluation goes. Jacobians are row-major, size × 6; null: not wanted.
struct ConstraintOutput {
  double* residual;
  double* by_pose = nullptr;
  double* by_previous = nullptr;
};

// Length of e.
int residual_size(const PoseConstraint& constraint);

// e and its Jacobians at poses of 12 numbers (cameras/pose.hpp); `previous` may be null where the
// kind does not read it. At ‖t − t_prev‖ = 0 the scale has no derivative, and zero stands for it.
void evaluate(const PoseConstraint& constraint,
              const double* pose,
              const double* previous,
              const ConstraintOutput& out);

// Throws InvalidArgument, naming `name`, for a kind that is not on poses and a measurement that
// cannot be one.
void validate(const PoseConstraint& constraint, const std::string& name);

// The constraints on intrinsics: values f, or cx and cy; Jacobians are multiples of the identity.
struct IntrinsicsResidual {
  std::array<double, 2> residual{};
  double by_values = 0.0;
  double by_reference = 0.0;
};
IntrinsicsResidual evaluate(ConstraintKind kind, const double* values, const double* reference);

}  // namespace sfmcpp::residuals

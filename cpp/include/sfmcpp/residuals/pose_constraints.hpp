// Constraints on poses and intrinsics, from a second sensor or from what is known beforehand: every
// row of thesis table 5.1 (EQUATIONS §7). Each is a MEAN squared error ε = ‖e‖²: e is divided by
// the root of its dimension, so that the number of constrained parameters does not change the
// importance.
//
// Frames. A pose is [R | t], rotation world_from_camera and centre in the world. With R̂, t̂, ŝ the
// measurement, "previous" the earlier of two poses and T the 4×4 matrix of a pose:
//
//   name                        e, before the division                       frame of the
//   measurement pose                        T⁻¹ T̂ − I: Rᵀ R̂ − I and Rᵀ (t̂ − t)           world
//   position                    t − t̂                                        world
//   orientation                 Rᵀ R̂ − I                                     world
//   orientation-reprojections   π(R, t, Q_j) − π(R̂, t, Q_j)                  world
//   displacement-pose           D⁻¹ D̂ − I, D = T_prev⁻¹ T                    previous camera
//   displacement-translation    t − t_prev − t̂                               world
//   displacement-rotation       (R_prevᵀ R)ᵀ R̂ − I                           previous camera
//   displacement-rotation-log   log(R̂ᵀ R_prevᵀ R)                            previous camera
//   scale                       ‖t − t_prev‖ − ŝ                             any
//   smoothing                   [Rᵀ | −Rᵀt] − [R_prevᵀ | −R_prevᵀ t_prev]    none
//   smoothing-reprojections     π(R, t, Q_j) − π(R_prev, t_prev, Q_j)        none
//   focal                       log(f̂ / f)                                   none
//   principal-point             c − ĉ                                        pixels
//
// The dimension counts entries (12 for poses and projection matrices, 9 for rotation matrices); for
// reprojections it counts points, as in the vision cost. Where the thesis takes the difference of
// Euler angles, which leaps where the motion passes half a turn, the log of the error's rotation
// leaps only where the error is half a turn. The projection matrix is that of normalised images.
//
// Jacobians are by the tangents of note §2: R ← R exp([δR]×), t ← t + δt; columns (δR, δt).
#pragma once

#include <array>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include <Eigen/Core>

#include "sfmcpp/core/enum_names.hpp"

namespace sfmcpp {

namespace residuals {

enum class PoseConstraintKind {
  kPose,
  kPosition,
  kOrientation,
  kOrientationReprojections,
  kDisplacementPose,
  kDisplacementTranslation,
  kDisplacementRotation,
  kDisplacementRotationLog,
  kScale,
  kSmoothing,
  kSmoothingReprojections
};

enum class IntrinsicsConstraintKind { kFocal, kPrincipalPoint };

}  // namespace residuals

template <>
struct EnumNames<residuals::PoseConstraintKind> {
  using Kind = residuals::PoseConstraintKind;
  static constexpr std::string_view kWhat = "kind";
  static constexpr std::array<std::pair<Kind, std::string_view>, 11> kTable{
      {{Kind::kPose, "pose"},
       {Kind::kPosition, "position"},
       {Kind::kOrientation, "orientation"},
       {Kind::kOrientationReprojections, "orientation-reprojections"},
       {Kind::kDisplacementPose, "displacement-pose"},
       {Kind::kDisplacementTranslation, "displacement-translation"},
       {Kind::kDisplacementRotation, "displacement-rotation"},
       {Kind::kDisplacementRotationLog, "displacement-rotation-log"},
       {Kind::kScale, "scale"},
       {Kind::kSmoothing, "smoothing"},
       {Kind::kSmoothingReprojections, "smoothing-reprojections"}}};
};

template <>
struct EnumNames<residuals::IntrinsicsConstraintKind> {
  using Kind = residuals::IntrinsicsConstraintKind;
  static constexpr std::string_view kWhat = "kind";
  static constexpr std::array<std::pair<Kind, std::string_view>, 2> kTable{
      {{Kind::kFocal, "focal"}, {Kind::kPrincipalPoint, "principal-point"}}};
};

namespace residuals {

// What was measured; a kind reads the parts that its equation names. The frozen points of the
// reprojection forms are the caller's and must be in front of both cameras.
struct PoseConstraint {
  PoseConstraintKind kind = PoseConstraintKind::kPosition;
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

// Whether the constraint compares images of its frozen points.
bool compares_images(PoseConstraintKind kind);

// Whether the constraint reads the previous pose.
bool relates_two_poses(PoseConstraintKind kind);

// Length of e.
int residual_size(const PoseConstraint& constraint);

// e and its Jacobians at poses of 12 numbers (cameras/pose.hpp); `previous` may be null where the
// kind does not read it. At ‖t − t_prev‖ = 0 the scale has no derivative, and zero stands for it.
void evaluate(const PoseConstraint& constraint,
              const double* pose,
              const double* previous,
              const ConstraintOutput& out);

// Throws InvalidArgument, naming `name`, for a measurement that cannot be one.
void validate(const PoseConstraint& constraint, const std::string& name);

// The constraints on intrinsics: values f, or cx and cy; Jacobians are multiples of the identity.
struct IntrinsicsResidual {
  std::array<double, 2> residual{};
  double by_values = 0.0;
  double by_reference = 0.0;
};
int residual_size(IntrinsicsConstraintKind kind);
IntrinsicsResidual evaluate(IntrinsicsConstraintKind kind,
                            const double* values,
                            const double* reference);

}  // namespace residuals
}  // namespace sfmcpp

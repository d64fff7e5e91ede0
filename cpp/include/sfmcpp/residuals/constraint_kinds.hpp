// The kinds of constraints on cameras, from a second sensor or from what is known beforehand: every
// row of thesis table 5.1 (docs/equations.md §7), and all that is known of each, in one table.
//
// A constraint is a MEAN squared error ε = ‖e‖²: e is divided by the root of its dimension, so that
// the number of constrained parameters does not change the importance. The dimension counts entries
// (12 for poses and projection matrices, 9 for rotation matrices); where images of frozen points
// are compared it counts points, as in the vision cost.
//
// In the table a pose is [R | t], rotation world_from_camera and centre in the world; hats are
// measurements, "previous" is the earlier of two poses, T the 4×4 matrix of a pose, π the image of
// points. Where the thesis takes the difference of Euler angles, which leaps where the motion
// passes half a turn, the log of the error's rotation leaps only where the error is half a turn.
// The projection matrix is that of normalised images.
//
// How to add a constraint: an enumerator with its row in the table here, and its equation in a file
// of its own (or beside its like in src/residuals/pose_constraints.cpp): a function that writes e
// and its Jacobians. Everything else, in Python and on the command line too, comes from the row.
#pragma once

#include <array>
#include <string_view>

#include "sfmcpp/core/enum_names.hpp"

namespace sfmcpp {

namespace residuals {

enum class ConstraintKind {
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
  kSmoothingReprojections,
  kFocal,
  kPrincipalPoint
};

struct PoseConstraint;
struct ConstraintOutput;
struct IntrinsicsResidual;

// What was measured, and poses of 12 numbers (cameras/pose.hpp); `previous` is null for kinds on
// one camera.
struct ConstraintInput {
  const PoseConstraint& measured;
  const double* pose;
  const double* previous;
};

// The equation of a kind on poses: writes e and its Jacobians.
using PoseEquation = void(const ConstraintInput& in, const ConstraintOutput& out);
PoseEquation pose_equation, position_equation, orientation_equation,
    orientation_reprojections_equation, displacement_pose_equation,
    displacement_translation_equation, displacement_rotation_equation,
    displacement_rotation_log_equation, scale_equation, smoothing_equation,
    smoothing_reprojections_equation;

// That of a kind on intrinsics, given the values of its parameters and what they should be.
using IntrinsicsEquation = IntrinsicsResidual(const double* values, const double* reference);
IntrinsicsEquation focal_equation, principal_point_equation;

// Shape of one measurement.
enum class Measurement { kNone, kScalar, kPair, kVector, kRotation, kPose };

constexpr int size_of(Measurement measurement) {
  return std::array{0, 1, 2, 3, 9, 12}[static_cast<std::size_t>(measurement)];
}

enum class CamerasOfMember { kOne, kTwo, kOneOrTwo };

struct ConstraintKindFacts {
  static constexpr int kTwoPerPoint = -2;

  ConstraintKind value;
  std::string_view name;
  Measurement measurement;
  CamerasOfMember cameras;
  int entries;  // of e; kTwoPerPoint: two for each frozen point, compared in images
  int freedom;  // independent equations where it holds: nine entries of a rotation are three
  std::string_view unit;  // of an error d of the sensor
  double spread;          // ‖d‖² / ε to first order; unused where it is the number of points
  std::string_view error;
  std::string_view frame;                             // of the measurement
  PoseEquation* equation = nullptr;                   // of kinds on poses
  IntrinsicsEquation* intrinsics_equation = nullptr;  // of kinds on intrinsics
  std::array<std::string_view, 2> parameters{};       // which they are on

  constexpr bool is_on_poses() const { return equation != nullptr; }
  constexpr bool compares_images() const { return entries == kTwoPerPoint; }
  constexpr bool relates_two_poses() const { return cameras == CamerasOfMember::kTwo; }
};

}  // namespace residuals

template <>
struct EnumTraits<residuals::ConstraintKind> {
  using Kind = residuals::ConstraintKind;
  using Is = residuals::Measurement;
  using Facts = residuals::ConstraintKindFacts;
  static constexpr auto kOne = residuals::CamerasOfMember::kOne;
  static constexpr auto kTwo = residuals::CamerasOfMember::kTwo;
  static constexpr auto kOneOrTwo = residuals::CamerasOfMember::kOneOrTwo;
  static constexpr int kTwoPerPoint = Facts::kTwoPerPoint;

  static constexpr std::string_view kWhat = "kind";
  // A small rotation φ has ‖RᵀR̂ − I‖² = 2‖φ‖². Poses mix metres and radians: theirs is the metre's.
  // clang-format off
  static constexpr auto kTable = std::to_array<Facts>({
      {Kind::kPose, "pose", Is::kPose, kOne, 12, 6, "m", 12.0,
       "T⁻¹ T̂ − I", "world_from_camera", residuals::pose_equation},
      {Kind::kPosition, "position", Is::kVector, kOne, 3, 3, "m", 3.0,
       "t − t̂", "world", residuals::position_equation},
      {Kind::kOrientation, "orientation", Is::kRotation, kOne, 9, 3, "rad", 4.5,
       "Rᵀ R̂ − I", "world_from_camera", residuals::orientation_equation},
      {Kind::kOrientationReprojections, "orientation-reprojections", Is::kRotation, kOne,
       kTwoPerPoint, 3, "px", 0.0,
       "images by R minus those by R̂ [px]", "world_from_camera",
       residuals::orientation_reprojections_equation},
      {Kind::kDisplacementPose, "displacement-pose", Is::kPose, kTwo, 12, 6, "m", 12.0,
       "D⁻¹ D̂ − I, D = T_previous⁻¹ T", "previous_from_camera",
       residuals::displacement_pose_equation},
      {Kind::kDisplacementTranslation, "displacement-translation", Is::kVector, kTwo, 3, 3, "m", 3.0,
       "t − t_previous − t̂", "world", residuals::displacement_translation_equation},
      {Kind::kDisplacementRotation, "displacement-rotation", Is::kRotation, kTwo, 9, 3, "rad", 4.5,
       "(R_previousᵀ R)ᵀ R̂ − I", "previous_from_camera", residuals::displacement_rotation_equation},
      {Kind::kDisplacementRotationLog, "displacement-rotation-log", Is::kRotation, kTwo, 3, 3, "rad",
       3.0, "log(R̂ᵀ R_previousᵀ R) [rad]", "previous_from_camera",
       residuals::displacement_rotation_log_equation},
      {Kind::kScale, "scale", Is::kScalar, kTwo, 1, 1, "m", 1.0,
       "‖t − t_previous‖ − value", "any", residuals::scale_equation},
      {Kind::kSmoothing, "smoothing", Is::kNone, kTwo, 12, 6, "m", 12.0,
       "[Rᵀ | −Rᵀ t] minus the previous one", "none", residuals::smoothing_equation},
      {Kind::kSmoothingReprojections, "smoothing-reprojections", Is::kNone, kTwo,
       kTwoPerPoint, 6, "px", 0.0,
       "images minus the previous ones [px]", "none", residuals::smoothing_reprojections_equation},
      {Kind::kFocal, "focal", Is::kScalar, kOneOrTwo, 1, 1, "of f", 1.0,
       "log(value / f)", "pixels", nullptr, residuals::focal_equation, {"f"}},
      {Kind::kPrincipalPoint, "principal-point", Is::kPair, kOneOrTwo, 2, 2, "px", 2.0,
       "(cx, cy) − value [px]", "pixels", nullptr, residuals::principal_point_equation,
       {"cx", "cy"}},
  });
  // clang-format on
};

}  // namespace sfmcpp

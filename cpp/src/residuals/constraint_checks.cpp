// What a constraint must be before it is evaluated, and the two constraints on intrinsics.
#include <cmath>
#include <numbers>

#include "sfmcpp/math/so3.hpp"
#include "sfmcpp/residuals/pose_constraints.hpp"

namespace sfmcpp::residuals {
namespace {

using Kind = PoseConstraintKind;

constexpr double kRotationTolerance = 1e-6;

[[noreturn]] void refuse(const std::string& name, const std::string& rule) {
  throw InvalidArgument(name + ": " + rule);
}

void require_rotation(const Eigen::Matrix3d& r, const std::string& name) {
  if (!is_rotation(r, kRotationTolerance))
    refuse(name, "must be a rotation matrix, orthonormal to 1e-6 and right-handed");
}

void require_points(std::span<const double> points, const std::string& name) {
  if (points.empty() || points.size() % 3 != 0)
    refuse(name, "must have three numbers for each of at least one point");
  for (double x : points) {
    if (!std::isfinite(x)) refuse(name, "must be finite");
  }
}

bool reads_rotation(Kind kind) {
  return kind == Kind::kPose || kind == Kind::kOrientation ||
         kind == Kind::kOrientationReprojections || kind == Kind::kDisplacementPose ||
         kind == Kind::kDisplacementRotation || kind == Kind::kDisplacementRotationLog;
}

}  // namespace

void validate(const PoseConstraint& c, const std::string& name) {
  if (reads_rotation(c.kind)) require_rotation(c.rotation, name + ".rotation");
  if (compares_images(c.kind)) require_points(c.points, name + ".points");
  if (!c.translation.allFinite()) refuse(name + ".translation", "must be finite");
  if (!(std::isfinite(c.distance) && c.distance >= 0.0)) {
    refuse(name + ".distance = " + std::to_string(c.distance), "must be finite and not negative");
  }
}

int residual_size(IntrinsicsConstraintKind kind) {
  return kind == IntrinsicsConstraintKind::kFocal ? 1 : 2;
}

IntrinsicsResidual evaluate(IntrinsicsConstraintKind kind,
                            const double* values,
                            const double* reference) {
  if (kind == IntrinsicsConstraintKind::kFocal)
    return {{std::log(*reference / *values), 0.0}, -1.0 / *values, 1.0 / *reference};
  const double factor = 1.0 / std::numbers::sqrt2;
  return {
      {factor * (values[0] - reference[0]), factor * (values[1] - reference[1])}, factor, -factor};
}

}  // namespace sfmcpp::residuals

#include "sfmcpp/residuals/pose_constraints.hpp"

#include <algorithm>
#include <cmath>

#include "sfmcpp/cameras/calibrated.hpp"
#include "sfmcpp/math/so3.hpp"

namespace sfmcpp::residuals {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Kind = PoseConstraintKind;
using PoseMatrix = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;

constexpr int kRotationColumn = 0;
constexpr int kCentreColumn = 3;
constexpr int kRotationEntries = 9;
constexpr int kPoseEntries = 12;

struct Pose {
  explicit Pose(const double* p)
      : rotation(Eigen::Map<const PoseMatrix>(p).leftCols<3>()),
        centre(Eigen::Map<const PoseMatrix>(p).col(3)) {}
  Pose(Matrix3d r, Vector3d t) : rotation(std::move(r)), centre(std::move(t)) {}

  Matrix3d rotation;
  Vector3d centre;
};

// Three rows of e and of its Jacobians at a time, already divided by the root of the dimension.
class Rows {
 public:
  Rows(const ConstraintOutput& out, int size, double dimension)
      : out_(out), factor_(1.0 / std::sqrt(dimension)) {
    for (double* jacobian : {out.by_pose, out.by_previous}) {
      if (jacobian != nullptr) std::fill_n(jacobian, size * 6, 0.0);
    }
  }

  void residual(int row, const Vector3d& value) const {
    Eigen::Map<Vector3d>(out_.residual + row) = factor_ * value;
  }
  void by_pose(int row, int column, const Matrix3d& value) const {
    put(out_.by_pose, row, column, value);
  }
  void by_previous(int row, int column, const Matrix3d& value) const {
    put(out_.by_previous, row, column, value);
  }

 private:
  void put(double* jacobian, int row, int column, const Matrix3d& value) const {
    using Wide = Eigen::Matrix<double, 3, 6, Eigen::RowMajor>;
    if (jacobian == nullptr) return;
    Eigen::Map<Wide>(jacobian + 6L * row).middleCols<3>(column) = factor_ * value;
  }

  const ConstraintOutput& out_;
  double factor_;
};

// What is measured by one pose, said in the world; with the previous pose P it moves along with:
// R̂ = R_P dR̂ by R_P [δ]× dR̂.
struct Target {
  Pose world;
  const PoseConstraint& measured;
};

Target absolute(const PoseConstraint& c) { return {Pose(c.rotation, c.translation), c}; }

Target relative(const PoseConstraint& c, const Pose& previous) {
  return {Pose(previous.rotation * c.rotation, previous.centre + previous.rotation * c.translation),
          c};
}

// RᵀR̂ − I, column by column: a column v moves by −δ × v = [v]× δ. By the previous pose's δ, with
// G = Rᵀ R_P and d the column of dR̂: G (δ × d) = −G [d]× δ.
void orientation_rows(const Pose& pose, const Target& target, const Pose* previous, Rows rows) {
  const Matrix3d error = pose.rotation.transpose() * target.world.rotation;
  for (int c = 0; c < 3; ++c) {
    rows.residual(3 * c, error.col(c) - Vector3d::Unit(c));
    rows.by_pose(3 * c, kRotationColumn, skew(error.col(c)));
  }
  if (previous == nullptr) return;
  const Matrix3d back = pose.rotation.transpose() * previous->rotation;
  for (int c = 0; c < 3; ++c)
    rows.by_previous(3 * c, kRotationColumn, -back * skew(target.measured.rotation.col(c)));
}

// Rᵀ (t̂ − t), below the orientation.
void position_in_camera_rows(const Pose& pose,
                             const Target& target,
                             const Pose* previous,
                             Rows rows) {
  const auto camera_from_world = pose.rotation.transpose();
  const Vector3d error = camera_from_world * (target.world.centre - pose.centre);
  rows.residual(kRotationEntries, error);
  rows.by_pose(kRotationEntries, kRotationColumn, skew(error));
  rows.by_pose(kRotationEntries, kCentreColumn, -camera_from_world);
  if (previous == nullptr) return;
  const Matrix3d back = camera_from_world * previous->rotation;
  rows.by_previous(kRotationEntries, kRotationColumn, -back * skew(target.measured.translation));
  rows.by_previous(kRotationEntries, kCentreColumn, camera_from_world);
}

void pose_rows(const Pose& pose, const Target& target, const Pose* previous, Rows rows) {
  orientation_rows(pose, target, previous, rows);
  position_in_camera_rows(pose, target, previous, rows);
}

void rotation_log_rows(const PoseConstraint& c, const Pose& pose, const Pose& previous, Rows rows) {
  const Matrix3d motion = previous.rotation.transpose() * pose.rotation;
  const Vector3d error = log_so3(c.rotation.transpose() * motion);
  const Matrix3d by_rotation = inverse_right_jacobian_so3(error);
  rows.residual(0, error);
  rows.by_pose(0, kRotationColumn, by_rotation);
  rows.by_previous(0, kRotationColumn, -by_rotation * motion.transpose());
}

void translation_rows(const Vector3d& error, Rows rows) {
  rows.residual(0, error);
  rows.by_pose(0, kCentreColumn, Matrix3d::Identity());
  rows.by_previous(0, kCentreColumn, -Matrix3d::Identity());
}

void scale_row(double distance, const Vector3d& moved, const ConstraintOutput& out) {
  const double length = moved.norm();
  const Vector3d direction = length > 0.0 ? Vector3d(moved / length) : Vector3d::Zero();
  *out.residual = length - distance;
  for (auto [jacobian, sign] : {std::pair(out.by_pose, 1.0), std::pair(out.by_previous, -1.0)}) {
    if (jacobian == nullptr) continue;
    Eigen::Map<Vector3d>(jacobian + kRotationColumn).setZero();
    Eigen::Map<Vector3d>(jacobian + kCentreColumn) = sign * direction;
  }
}

// Columns of [Rᵀ | −Rᵀt]: each moves by [v]× δR, the last one by −Rᵀ δt, too.
Eigen::Matrix<double, 3, 4> projection_matrix(const Pose& pose) {
  Eigen::Matrix<double, 3, 4> p;
  p << pose.rotation.transpose(), -pose.rotation.transpose() * pose.centre;
  return p;
}

void smoothing_rows(const Pose& pose, const Pose& previous, Rows rows) {
  const Eigen::Matrix<double, 3, 4> p = projection_matrix(pose), q = projection_matrix(previous);
  for (int c = 0; c < 4; ++c) {
    rows.residual(3 * c, p.col(c) - q.col(c));
    rows.by_pose(3 * c, kRotationColumn, skew(p.col(c)));
    rows.by_previous(3 * c, kRotationColumn, -skew(q.col(c)));
  }
  rows.by_pose(kRotationEntries, kCentreColumn, -pose.rotation.transpose());
  rows.by_previous(kRotationEntries, kCentreColumn, previous.rotation.transpose());
}

using Projected = LinearizedImagePoint<double, 6, 0>;

Projected projected(const PoseConstraint& c, const double* pose, int point) {
  Projected result;
  CalibratedCamera::linearize(pose, c.intrinsics.data(), c.points.data() + 3L * point, result);
  return result;
}

int num_points(const PoseConstraint& c) { return static_cast<int>(c.points.size()) / 3; }

// π(pose) − π(other); each Jacobian is that of its own camera.
void reprojection_rows(const PoseConstraint& c,
                       const double* pose,
                       const double* other,
                       const ConstraintOutput& out) {
  const double factor = 1.0 / std::sqrt(num_points(c));
  for (int j = 0; j < num_points(c); ++j) {
    const Projected here = projected(c, pose, j), there = projected(c, other, j);
    out.residual[2 * j] = factor * (here.image.u - there.image.u);
    out.residual[2 * j + 1] = factor * (here.image.v - there.image.v);
    for (int k = 0; k < 12; ++k) {
      const int row = k / 6, column = k % 6;
      if (out.by_pose != nullptr) out.by_pose[12 * j + k] = factor * here.camera[row][column];
      if (out.by_previous != nullptr)
        out.by_previous[12 * j + k] = -factor * there.camera[row][column];
    }
  }
}

// The other camera has the measured rotation but the same centre, and moves with it.
void orientation_reprojection_rows(const PoseConstraint& c,
                                   const double* pose,
                                   const ConstraintOutput& out) {
  PoseMatrix turned = Eigen::Map<const PoseMatrix>(pose);
  turned.leftCols<3>() = c.rotation;
  reprojection_rows(c, pose, turned.data(), {out.residual, out.by_pose});
  if (out.by_previous != nullptr) std::fill_n(out.by_previous, 12L * num_points(c), 0.0);
  if (out.by_pose == nullptr) return;
  const double factor = 1.0 / std::sqrt(num_points(c));
  for (int j = 0; j < num_points(c); ++j) {
    const Projected there = projected(c, turned.data(), j);
    for (int row = 0; row < 2; ++row) {
      for (int k = kCentreColumn; k < 6; ++k)
        out.by_pose[12 * j + 6 * row + k] -= factor * there.camera[row][k];
    }
  }
}

}  // namespace

bool compares_images(Kind kind) {
  return kind == Kind::kOrientationReprojections || kind == Kind::kSmoothingReprojections;
}

bool relates_two_poses(Kind kind) { return kind >= Kind::kDisplacementPose; }

int residual_size(const PoseConstraint& c) {
  switch (c.kind) {
    case Kind::kPose:
    case Kind::kDisplacementPose:
    case Kind::kSmoothing:
      return kPoseEntries;
    case Kind::kOrientation:
    case Kind::kDisplacementRotation:
      return kRotationEntries;
    case Kind::kScale:
      return 1;
    case Kind::kOrientationReprojections:
    case Kind::kSmoothingReprojections:
      return 2 * num_points(c);
    case Kind::kPosition:
    case Kind::kDisplacementTranslation:
    case Kind::kDisplacementRotationLog:
      break;
  }
  return 3;
}

void evaluate(const PoseConstraint& c,
              const double* pose_numbers,
              const double* previous_numbers,
              const ConstraintOutput& out) {
  if (c.kind == Kind::kOrientationReprojections)
    return orientation_reprojection_rows(c, pose_numbers, out);
  if (c.kind == Kind::kSmoothingReprojections)
    return reprojection_rows(c, pose_numbers, previous_numbers, out);
  const Pose pose(pose_numbers);
  const Pose previous(relates_two_poses(c.kind) ? previous_numbers : pose_numbers);
  const Vector3d moved = pose.centre - previous.centre;
  if (c.kind == Kind::kScale) return scale_row(c.distance, moved, out);
  const int size = residual_size(c);
  const Rows rows(out, size, size);
  switch (c.kind) {
    case Kind::kPose:
      return pose_rows(pose, absolute(c), nullptr, rows);
    case Kind::kOrientation:
      return orientation_rows(pose, absolute(c), nullptr, rows);
    case Kind::kDisplacementPose:
      return pose_rows(pose, relative(c, previous), &previous, rows);
    case Kind::kDisplacementRotation:
      return orientation_rows(pose, relative(c, previous), &previous, rows);
    case Kind::kDisplacementRotationLog:
      return rotation_log_rows(c, pose, previous, rows);
    case Kind::kSmoothing:
      return smoothing_rows(pose, previous, rows);
    case Kind::kDisplacementTranslation:
      return translation_rows(moved - c.translation, rows);
    default:
      rows.residual(0, pose.centre - c.translation);
      rows.by_pose(0, kCentreColumn, Matrix3d::Identity());
  }
}

}  // namespace sfmcpp::residuals

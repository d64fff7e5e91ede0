#include "sfmcpp/residuals/pose_constraints.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sfmcpp/cameras/calibrated.hpp"
#include "sfmcpp/cameras/matrix34.hpp"
#include "sfmcpp/math/so3.hpp"

namespace sfmcpp::residuals {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kRotationColumn = 0;
constexpr int kCentreColumn = 3;
constexpr int kRotationEntries = 9;

struct Pose {
  explicit Pose(const double* p)
      : rotation(PoseMatrixView(p).leftCols<3>()), centre(PoseMatrixView(p).col(3)) {}
  Pose(Matrix3d r, Vector3d t) : rotation(std::move(r)), centre(std::move(t)) {}

  Matrix3d rotation;
  Vector3d centre;
};

// Three rows of e and of its Jacobians at a time, already divided by the root of the dimension.
class Rows {
 public:
  Rows(const PoseConstraint& constraint, const ConstraintOutput& out) : out_(out) {
    const int size = facts_of(constraint.kind).entries;
    factor_ = 1.0 / std::sqrt(size);
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
void put_orientation(const Pose& pose, const Target& target, const Pose* previous, Rows rows) {
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
void put_position_in_camera(const Pose& pose,
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

void put_pose(const Pose& pose, const Target& target, const Pose* previous, Rows rows) {
  put_orientation(pose, target, previous, rows);
  put_position_in_camera(pose, target, previous, rows);
}

// Columns of [Rᵀ | −Rᵀt]: each moves by [v]× δR, the last one by −Rᵀ δt, too.
Eigen::Matrix<double, 3, 4> projection_matrix(const Pose& pose) {
  Eigen::Matrix<double, 3, 4> p;
  p << pose.rotation.transpose(), -pose.rotation.transpose() * pose.centre;
  return p;
}

using Projected = LinearizedImagePoint<double, 6, 0>;

Projected projected(const PoseConstraint& c, const double* pose, int point) {
  Projected result;
  CalibratedCamera::linearize(pose, c.intrinsics.data(), c.points.data() + 3L * point, result);
  return result;
}

int num_points(const PoseConstraint& c) { return static_cast<int>(c.points.size()) / 3; }

// π(pose) − π(other); each Jacobian is that of its own camera.
void put_images(const PoseConstraint& c,
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

void require_points(std::span<const double> points, const std::string& name) {
  if (points.empty() || points.size() % 3 != 0)
    refuse(name, "must have three numbers for each of at least one point");
  for (double x : points) {
    if (!std::isfinite(x)) refuse(name, "must be finite");
  }
}

}  // namespace

void pose_equation(const ConstraintInput& in, const ConstraintOutput& out) {
  put_pose(Pose(in.pose), absolute(in.measured), nullptr, Rows(in.measured, out));
}

void position_equation(const ConstraintInput& in, const ConstraintOutput& out) {
  const Rows rows(in.measured, out);
  rows.residual(0, Pose(in.pose).centre - in.measured.translation);
  rows.by_pose(0, kCentreColumn, Matrix3d::Identity());
}

void orientation_equation(const ConstraintInput& in, const ConstraintOutput& out) {
  put_orientation(Pose(in.pose), absolute(in.measured), nullptr, Rows(in.measured, out));
}

// The other camera has the measured rotation but the same centre, and moves with it.
void orientation_reprojections_equation(const ConstraintInput& in, const ConstraintOutput& out) {
  const PoseConstraint& c = in.measured;
  PoseMatrix turned = PoseMatrixView(in.pose);
  turned.leftCols<3>() = c.rotation;
  put_images(c, in.pose, turned.data(), {out.residual, out.by_pose});
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

void displacement_pose_equation(const ConstraintInput& in, const ConstraintOutput& out) {
  const Pose before(in.previous);
  put_pose(Pose(in.pose), relative(in.measured, before), &before, Rows(in.measured, out));
}

void displacement_translation_equation(const ConstraintInput& in, const ConstraintOutput& out) {
  const Rows rows(in.measured, out);
  rows.residual(0, (Pose(in.pose).centre - Pose(in.previous).centre) - in.measured.translation);
  rows.by_pose(0, kCentreColumn, Matrix3d::Identity());
  rows.by_previous(0, kCentreColumn, -Matrix3d::Identity());
}

void displacement_rotation_equation(const ConstraintInput& in, const ConstraintOutput& out) {
  const Pose before(in.previous);
  put_orientation(Pose(in.pose), relative(in.measured, before), &before, Rows(in.measured, out));
}

void displacement_rotation_log_equation(const ConstraintInput& in, const ConstraintOutput& out) {
  const Rows rows(in.measured, out);
  const Matrix3d motion = Pose(in.previous).rotation.transpose() * Pose(in.pose).rotation;
  const Vector3d error = log_so3(in.measured.rotation.transpose() * motion);
  const Matrix3d by_rotation = inverse_right_jacobian_so3(error);
  rows.residual(0, error);
  rows.by_pose(0, kRotationColumn, by_rotation);
  rows.by_previous(0, kRotationColumn, -by_rotation * motion.transpose());
}

void scale_equation(const ConstraintInput& in, const ConstraintOutput& out) {
  const Vector3d moved = Pose(in.pose).centre - Pose(in.previous).centre;
  const double length = moved.norm();
  const Vector3d direction = length > 0.0 ? Vector3d(moved / length) : Vector3d::Zero();
  *out.residual = length - in.measured.distance;
  for (auto [jacobian, sign] : {std::pair(out.by_pose, 1.0), std::pair(out.by_previous, -1.0)}) {
    if (jacobian == nullptr) continue;
    Eigen::Map<Vector3d>(jacobian + kRotationColumn).setZero();
    Eigen::Map<Vector3d>(jacobian + kCentreColumn) = sign * direction;
  }
}

void smoothing_equation(const ConstraintInput& in, const ConstraintOutput& out) {
  const Pose pose(in.pose), previous(in.previous);
  const Rows rows(in.measured, out);
  const Eigen::Matrix<double, 3, 4> p = projection_matrix(pose), q = projection_matrix(previous);
  for (int column = 0; column < 4; ++column) {
    rows.residual(3 * column, p.col(column) - q.col(column));
    rows.by_pose(3 * column, kRotationColumn, skew(p.col(column)));
    rows.by_previous(3 * column, kRotationColumn, -skew(q.col(column)));
  }
  rows.by_pose(kRotationEntries, kCentreColumn, -pose.rotation.transpose());
  rows.by_previous(kRotationEntries, kCentreColumn, previous.rotation.transpose());
}

void smoothing_reprojections_equation(const ConstraintInput& in, const ConstraintOutput& out) {
  put_images(in.measured, in.pose, in.previous, out);
}

IntrinsicsResidual focal_equation(const double* values, const double* reference) {
  return {{std::log(*reference / *values), 0.0}, -1.0 / *values, 1.0 / *reference};
}

IntrinsicsResidual principal_point_equation(const double* values, const double* reference) {
  const double factor = 1.0 / std::numbers::sqrt2;
  return {
      {factor * (values[0] - reference[0]), factor * (values[1] - reference[1])}, factor, -factor};
}

int residual_size(const PoseConstraint& c) {
  const ConstraintKindFacts& facts = facts_of(c.kind);
  return facts.compares_images() ? 2 * num_points(c) : facts.entries;
}

void evaluate(const PoseConstraint& c,
              const double* pose,
              const double* previous,
              const ConstraintOutput& out) {
  facts_of(c.kind).equation({c, pose, previous}, out);
}

IntrinsicsResidual evaluate(ConstraintKind kind, const double* values, const double* reference) {
  return facts_of(kind).intrinsics_equation(values, reference);
}

void validate(const PoseConstraint& c, const std::string& name) {
  const ConstraintKindFacts& facts = facts_of(c.kind);
  if (!facts.is_on_poses())
    refuse(name + ".kind = '" + std::string(facts.name) + "'", "must be a constraint on poses");
  const bool on_rotation =
      facts.measurement == Measurement::kRotation || facts.measurement == Measurement::kPose;
  if (on_rotation && !is_rotation(c.rotation))
    refuse(name + ".rotation", "must be a rotation matrix, orthonormal to 1e-6 and right-handed");
  if (facts.compares_images()) require_points(c.points, name + ".points");
  if (!c.translation.allFinite()) refuse(name + ".translation", "must be finite");
  if (!(std::isfinite(c.distance) && c.distance >= 0.0)) {
    refuse(name + ".distance = " + std::to_string(c.distance), "must be finite and not negative");
  }
}

}  // namespace sfmcpp::residuals

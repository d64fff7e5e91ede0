// Every constraint against its equation in the header, written with 4×4 matrices, and every
// Jacobian against numeric derivatives.
#include "sfmcpp/residuals/pose_constraints.hpp"

#include <cmath>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "support/constraint_setting.hpp"

namespace sfmcpp::pose_constraints_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;
using residuals::Measurement;
using residuals::PoseConstraint;
using support::analytic;
using support::expect_close;
using support::Jacobians;
using support::matrix_of;
using support::numeric;
using support::pose_of;
using support::PoseNumbers;
using Kind = residuals::ConstraintKind;
using Setting = support::ConstraintSetting;

Vector2d image(const PoseConstraint& c, const Matrix4d& world_from_camera, int point) {
  Matrix3d k;
  const auto& [f, aspect, cx, cy, skew_px] = c.intrinsics;
  k << f, skew_px, cx, 0, aspect * f, cy, 0, 0, 1;
  const Vector3d world(c.points[3 * point], c.points[3 * point + 1], c.points[3 * point + 2]);
  return (k * (world_from_camera.inverse() * world.homogeneous()).head<3>()).hnormalized();
}

double mean_image_distance(const PoseConstraint& c, const Matrix4d& a, const Matrix4d& b) {
  const int count = static_cast<int>(c.points.size()) / 3;
  double sum = 0.0;
  for (int j = 0; j < count; ++j) sum += (image(c, a, j) - image(c, b, j)).squaredNorm();
  return sum / count;
}

// ε of the table in the header.
double expected_error(const Setting& s) {
  const PoseConstraint& c = s.constraint;
  const Matrix4d t = matrix_of(s.pose), p = matrix_of(s.previous);
  const Matrix3d r = t.topLeftCorner<3, 3>(), rp = p.topLeftCorner<3, 3>();
  const Vector3d centre = t.topRightCorner<3, 1>(), moved = centre - p.topRightCorner<3, 1>();
  Matrix4d measured = matrix_of(pose_of(c.rotation, c.translation));
  const Matrix4d one = Matrix4d::Identity();
  switch (c.kind) {
    case Kind::kPose:
      return (t.inverse() * measured - one).squaredNorm() / 12;
    case Kind::kPosition:
      return (centre - c.translation).squaredNorm() / 3;
    case Kind::kOrientation:
      return (r.transpose() * c.rotation - Matrix3d::Identity()).squaredNorm() / 9;
    case Kind::kOrientationReprojections:
      measured.topRightCorner<3, 1>() = centre;
      return mean_image_distance(c, t, measured);
    case Kind::kDisplacementPose:
      return ((p.inverse() * t).inverse() * measured - one).squaredNorm() / 12;
    case Kind::kDisplacementTranslation:
      return (moved - c.translation).squaredNorm() / 3;
    case Kind::kDisplacementRotation:
      return ((rp.transpose() * r).transpose() * c.rotation - Matrix3d::Identity()).squaredNorm() /
             9;
    case Kind::kDisplacementRotationLog: {
      const double angle = Eigen::AngleAxisd(c.rotation.transpose() * rp.transpose() * r).angle();
      return angle * angle / 3;
    }
    case Kind::kScale:
      return std::pow(moved.norm() - c.distance, 2);
    case Kind::kSmoothing:
      return (t.inverse() - p.inverse()).squaredNorm() / 12;
    case Kind::kSmoothingReprojections:
      return mean_image_distance(c, t, p);
    default:
      break;
  }
  return -1.0;
}

class EveryConstraint : public testing::TestWithParam<Kind> {};

TEST_P(EveryConstraint, IsTheMeanSquareOfItsEquation) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const Setting s(GetParam(), seed);
    const double expected = expected_error(s);
    ASSERT_GT(expected, 1e-6);
    EXPECT_NEAR(s.residual().squaredNorm() / expected, 1.0, 1e-11);
  }
}

TEST_P(EveryConstraint, JacobiansAreTheNumericOnes) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const Setting s(GetParam(), seed);
    const Jacobians a = analytic(s), n = numeric(s);
    expect_close(a.by_pose, n.by_pose, 1e-8);
    expect_close(a.by_previous, n.by_previous, 1e-8);
    EXPECT_EQ(facts_of(GetParam()).relates_two_poses(), n.by_previous.norm() > 0.0);
  }
}

// What a sensor without error measures; nothing moves where that is the kind's wish.
void measure(Setting& s) {
  if (facts_of(s.constraint.kind).measurement == Measurement::kNone) s.previous = s.pose;
  const Matrix4d t = matrix_of(s.pose), p = matrix_of(s.previous), d = p.inverse() * t;
  const Kind kind = s.constraint.kind;
  const Matrix4d& measured = facts_of(kind).relates_two_poses() ? d : t;
  s.constraint.rotation = measured.topLeftCorner<3, 3>();
  s.constraint.translation = kind == Kind::kDisplacementTranslation
                                 ? Vector3d((t - p).topRightCorner<3, 1>())
                                 : Vector3d(measured.topRightCorner<3, 1>());
  s.constraint.distance = (t - p).topRightCorner<3, 1>().norm();
}

TEST_P(EveryConstraint, VanishesWhereTheMeasurementIsRight) {
  Setting s(GetParam());
  measure(s);
  EXPECT_LT(s.residual().norm(), 1e-12);
}

TEST_P(EveryConstraint, HasAsManyIndependentEquationsAsItsFactsSayWhereItHolds) {
  Setting s(GetParam());
  measure(s);
  const Jacobians a = analytic(s);
  Eigen::MatrixXd both(a.by_pose.rows(), 12);
  both << a.by_pose, a.by_previous;
  EXPECT_EQ(Eigen::FullPivLU<Eigen::MatrixXd>(both).setThreshold(1e-9).rank(),
            facts_of(GetParam()).freedom);
}

// A small error d of the sensor, in its unit, makes the mean squared error ‖d‖² / spread.
TEST_P(EveryConstraint, ErrorsOfTheSensorMakeTheMeanSquaredErrorOfItsSpread) {
  const residuals::ConstraintKindFacts& facts = facts_of(GetParam());
  if (facts.compares_images() || facts.measurement == Measurement::kNone) return;
  Setting s(GetParam());
  measure(s);
  const Vector3d error = s.vector(1e-5);
  double squared = error.squaredNorm();
  if (facts.unit == "rad") {
    s.constraint.rotation *= exp_so3(error);
  } else if (facts.measurement == Measurement::kScalar) {
    s.constraint.distance += error[0];
    squared = error[0] * error[0];
  } else {
    s.constraint.translation += error;
  }
  EXPECT_NEAR(s.residual().squaredNorm() * facts.spread / squared, 1.0, 1e-4);
}

// A world turned and moved as a whole changes what relates two poses only where it is said in the
// world.
TEST_P(EveryConstraint, RelativeOnesInTheFrameOfTheCameraIgnoreTheWorldFrame) {
  const bool relative = GetParam() == Kind::kDisplacementPose ||
                        GetParam() == Kind::kDisplacementRotation ||
                        GetParam() == Kind::kDisplacementRotationLog || GetParam() == Kind::kScale;
  Setting s(GetParam());
  const VectorXd before = s.residual();
  const Matrix4d world = matrix_of(pose_of(exp_so3(s.vector(1.0)), s.vector(5.0)));
  for (PoseNumbers* pose : {&s.pose, &s.previous}) {
    const Matrix4d turned = world * matrix_of(*pose);
    *pose = pose_of(turned.topLeftCorner<3, 3>(), turned.topRightCorner<3, 1>());
  }
  EXPECT_EQ(relative, (s.residual() - before).norm() < 1e-9);
}

std::string name_of(const testing::TestParamInfo<Kind>& tested) {
  std::string name(enum_name(tested.param));
  std::erase(name, '-');
  return name;
}

INSTANTIATE_TEST_SUITE_P(Table,
                         EveryConstraint,
                         testing::ValuesIn(support::kKindsOnPoses),
                         name_of);

}  // namespace
}  // namespace sfmcpp::pose_constraints_test

// Constraints where they are singular, those on intrinsics, and measurements that cannot be one.
#include <cmath>
#include <numbers>
#include <string>

#include <Eigen/QR>
#include <gtest/gtest.h>

#include "sfmcpp/residuals/constraint_set.hpp"
#include "sfmcpp/residuals/pose_constraints.hpp"
#include "support/constraint_setting.hpp"
#include "support/enumerators.hpp"

namespace sfmcpp::constraint_limits_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;
using residuals::PoseConstraint;
using support::analytic;
using support::expect_close;
using support::Jacobians;
using support::matrix_of;
using support::numeric;
using support::pose_of;
using Kind = residuals::ConstraintKind;
using Setting = support::ConstraintSetting;

// What counts against unknowns is not how many numbers are compared, but what they can tell where
// they agree: a pose like the one before tells six numbers, not twelve.
TEST(NumEquations, AreTheRankOfTheJacobian) {
  for (Kind kind : support::all_enumerators<Kind>()) {
    if (!facts_of(kind).is_on_poses()) continue;
    for (std::size_t images : {1, 2, 7}) {
      Setting s(kind);
      s.points.resize(3 * images);
      s.constraint.points = s.points;
      if (kind == Kind::kSmoothing || kind == Kind::kSmoothingReprojections) s.previous = s.pose;
      if (kind == Kind::kOrientationReprojections)
        s.constraint.rotation = matrix_of(s.pose).topLeftCorner<3, 3>();
      const Jacobians a = analytic(s);
      Eigen::MatrixXd both(a.by_pose.rows(), 12);
      both << a.by_pose, a.by_previous;
      const residuals::ConstraintGroup group{.name = "group", .kind = kind};
      const residuals::ConstraintMember member{.points = s.points};
      EXPECT_EQ(residuals::num_equations(group, member),
                Eigen::ColPivHouseholderQR<Eigen::MatrixXd>(both).setThreshold(1e-9).rank())
          << enum_name(kind) << ", " << images << " points";
    }
  }
}

TEST(ScaleConstraint, HasNoSlopeWhereTheCentresCoincide) {
  Setting s(Kind::kScale);
  s.previous = s.pose;
  const Jacobians a = analytic(s);
  EXPECT_EQ(s.residual()[0], -s.constraint.distance);
  EXPECT_TRUE(a.by_pose.isZero(0.0));
  EXPECT_TRUE(a.by_previous.isZero(0.0));
}

TEST(ScaleConstraint, IsExactForTinyDisplacements) {
  Setting s(Kind::kScale);
  s.previous = s.pose;
  s.previous[3] -= 1e-9;
  const Jacobians a = analytic(s);
  EXPECT_NEAR(a.by_pose(0, 3), 1.0, 1e-6);
  EXPECT_NEAR(a.by_pose.norm(), 1.0, 1e-12);
}

class RotationLogError : public testing::TestWithParam<double> {};

TEST_P(RotationLogError, JacobiansAreTheNumericOnesUpToHalfATurn) {
  Setting s(Kind::kDisplacementRotationLog);
  const Matrix3d motion =
      (matrix_of(s.previous).inverse() * matrix_of(s.pose)).topLeftCorner<3, 3>();
  s.constraint.rotation = motion * exp_so3(GetParam() * Vector3d(1, 2, -2).normalized());
  const double step = std::min(1e-3, 0.2 * (std::numbers::pi - GetParam()));
  const Jacobians a = analytic(s), n = numeric(s, step);
  expect_close(a.by_pose, n.by_pose, 1e-7);
  expect_close(a.by_previous, n.by_previous, 1e-7);
  EXPECT_NEAR(s.residual().norm(), GetParam() / std::sqrt(3.0), 1e-12);
}

INSTANTIATE_TEST_SUITE_P(
    Angles,
    RotationLogError,
    testing::Values(0.0, 1e-6, 0.009, 0.011, 1.0, 3.0, std::numbers::pi - 1e-4));

TEST(RotationLogError, StaysFiniteAtHalfATurnAndDoesNotLeapWithTheMotion) {
  Setting s(Kind::kDisplacementRotationLog);
  s.previous = pose_of(Matrix3d::Identity(), Vector3d::Zero());
  for (double angle : {3.1, std::numbers::pi, 3.2}) {
    s.pose = pose_of(exp_so3({angle, 0, 0}), Vector3d::Zero());
    s.constraint.rotation = exp_so3({angle - 0.1, 0, 0});
    EXPECT_NEAR(s.residual()[0], 0.1 / std::sqrt(3.0), 1e-12) << angle;
    s.constraint.rotation = Matrix3d::Identity();
    EXPECT_TRUE(analytic(s).by_pose.allFinite()) << angle;
  }
}

TEST(IntrinsicsConstraint, FocalIsTheLogOfTheRatio) {
  const double f = 700.0, reference = 500.0;
  const auto at = residuals::evaluate(Kind::kFocal, &f, &reference);
  EXPECT_DOUBLE_EQ(at.residual[0], std::log(reference / f));
  const auto by_f = [&](const VectorXd& d) {
    return VectorXd::Constant(1, std::log(reference / (f + d[0])));
  };
  const auto by_reference = [&](const VectorXd& d) {
    return VectorXd::Constant(1, std::log((reference + d[0]) / f));
  };
  const VectorXd step = VectorXd::Constant(1, 0.1);
  EXPECT_NEAR(at.by_values, numeric_jacobian(by_f, step)(0, 0), 1e-12);
  EXPECT_NEAR(at.by_reference, numeric_jacobian(by_reference, step)(0, 0), 1e-12);
  EXPECT_EQ(facts_of(Kind::kFocal).entries, 1);
}

TEST(IntrinsicsConstraint, PrincipalPointIsAMeanSquareOfPixels) {
  const Vector2d c(320.0, 240.0), reference(317.0, 244.0);
  const auto at = residuals::evaluate(Kind::kPrincipalPoint, c.data(), reference.data());
  EXPECT_DOUBLE_EQ(Vector2d(at.residual.data()).squaredNorm(), 25.0 / 2.0);
  EXPECT_DOUBLE_EQ(at.by_values, at.residual[0] / 3.0);
  EXPECT_DOUBLE_EQ(at.by_reference, -at.by_values);
}

std::string complaint(const PoseConstraint& c) {
  try {
    residuals::validate(c, "gyro");
  } catch (const InvalidArgument& e) {
    return e.what();
  }
  return "";
}

TEST(ConstraintCheck, NamesWhatCannotBeMeasured) {
  const Setting fine(Kind::kOrientation);
  EXPECT_EQ(complaint(fine.constraint), "");
  PoseConstraint c = fine.constraint;
  c.rotation(0, 0) += 1e-3;
  EXPECT_NE(complaint(c).find("gyro.rotation"), std::string::npos);
  c = fine.constraint;
  c.rotation.col(0) *= -1.0;
  EXPECT_NE(complaint(c).find("gyro.rotation"), std::string::npos);
  c = fine.constraint;
  c.distance = -1.0;
  EXPECT_NE(complaint(c).find("gyro.distance = -1"), std::string::npos);
  c = fine.constraint;
  c.translation[1] = std::nan("");
  EXPECT_NE(complaint(c).find("gyro.translation"), std::string::npos);
  c = Setting(Kind::kSmoothingReprojections).constraint;
  c.points = {};
  EXPECT_NE(complaint(c).find("gyro.points"), std::string::npos);
}

}  // namespace
}  // namespace sfmcpp::constraint_limits_test

#include "sfmcpp/math/so3.hpp"

#include <algorithm>
#include <numbers>
#include <random>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "sfmcpp/math/numeric_diff.hpp"

namespace sfmcpp::so3_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Vector3d random_axis(unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  return Vector3d(normal(random), normal(random), normal(random)).normalized();
}

class So3 : public testing::TestWithParam<double> {};

TEST_P(So3, ExpIsTheRotationByTheAngleAboutTheAxis) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const Vector3d axis = random_axis(seed);
    const Matrix3d expected = Eigen::AngleAxisd(GetParam(), axis).toRotationMatrix();
    EXPECT_LT((exp_so3(GetParam() * axis) - expected).cwiseAbs().maxCoeff(), 1e-15);
  }
}

TEST_P(So3, LogUndoesExpRelativeToTheAngle) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const Vector3d w = GetParam() * random_axis(seed);
    const Vector3d back = log_so3(exp_so3(w));
    EXPECT_LE(std::min((back - w).norm(), (back + w).norm()), 1e-14 * std::max(GetParam(), 1e-2));
    // At π both directions of the axis are the same rotation.
    if (GetParam() < 3.1) {
      EXPECT_LE((back - w).norm(), 1e-14 * std::max(GetParam(), 1e-2));
    }
    EXPECT_LE(back.norm(), std::numbers::pi + 1e-15);
  }
}

TEST_P(So3, InverseRightJacobianIsTheNumericOne) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const Vector3d w = GetParam() * random_axis(seed);
    const auto moved = [&](const Eigen::VectorXd& delta) -> Eigen::VectorXd {
      const Vector3d back = log_so3(exp_so3(w) * exp_so3(delta));
      return (back - w).norm() < 1.0 ? back
                                     : Vector3d((1 - 2 * std::numbers::pi / back.norm()) * back);
    };
    const Eigen::MatrixXd numeric = numeric_jacobian(moved, Vector3d::Constant(1e-3));
    EXPECT_LT((inverse_right_jacobian_so3(w) - numeric).cwiseAbs().maxCoeff(), 1e-8);
  }
}

INSTANTIATE_TEST_SUITE_P(Angles,
                         So3,
                         testing::Values(0.0,
                                         1e-9,
                                         1e-5,
                                         1e-3,
                                         0.00999,
                                         0.01001,
                                         1.0,
                                         3.0,
                                         std::numbers::pi - 1e-7,
                                         std::numbers::pi));

TEST(So3Small, LogKeepsTheDigitsOfTinyAngles) {
  const Vector3d w(3e-9, -2e-9, 1e-9);
  EXPECT_LT((log_so3(exp_so3(w)) - w).norm(), 1e-14 * w.norm());
}

TEST(So3Small, LogOfTwoTurnsIsTheShortestRotation) {
  const Vector3d axis = random_axis(7);
  const Vector3d w = log_so3(exp_so3((2 * std::numbers::pi - 0.5) * axis));
  EXPECT_LT((w + 0.5 * axis).norm(), 1e-14);
}

TEST(IsRotation, TellsRotationsFromReflectionsAndFromWhatIsNotOrthonormal) {
  const Matrix3d rotation = exp_so3(Vector3d(0.4, -1.1, 0.7));
  EXPECT_TRUE(is_rotation(rotation, 1e-14));
  EXPECT_FALSE(is_rotation(-rotation, 1e-6));
  EXPECT_FALSE(is_rotation(1.001 * rotation, 1e-6));
  EXPECT_TRUE(is_rotation(1.001 * rotation, 1e-2));
  EXPECT_FALSE(is_rotation(std::numeric_limits<double>::quiet_NaN() * rotation, 1e-6));
}

TEST(Skew, MultipliesLikeTheCrossProduct) {
  const Vector3d a(1.0, -2.0, 0.5), b(0.3, 4.0, -1.0);
  EXPECT_EQ(skew(a) * b, a.cross(b));
  EXPECT_EQ(skew(a).transpose(), -skew(a));
}

TEST(Orthonormalized, ErrorOfAnAlmostRotationIsSquared) {
  const Matrix3d rotation = exp_so3(Vector3d(0.4, -1.1, 0.7));
  Matrix3d noise;
  noise << 1, -2, 3, 0.5, 1.5, -1, 2, 0, -0.7;
  for (double error : {1e-3, 1e-5}) {
    const Matrix3d r = orthonormalized(rotation + error * noise);
    const double left = (r * r.transpose() - Matrix3d::Identity()).norm();
    EXPECT_LT(left, 50 * error * error);
  }
}

}  // namespace
}  // namespace sfmcpp::so3_test

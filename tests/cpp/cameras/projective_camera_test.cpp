// The uncalibrated camera against the calibrated one, and what no image of it can see.
#include <random>

#include <Eigen/Core>
#include <Eigen/LU>
#include <gtest/gtest.h>

#include "sfmcpp/cameras/calibrated.hpp"
#include "sfmcpp/cameras/projective.hpp"
#include "sfmcpp/math/numeric_diff.hpp"
#include "support/random_views.hpp"

namespace sfmcpp::projective_camera_test {
namespace {

using Eigen::Map;
using Eigen::Matrix4d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector4d;
using Eigen::VectorXd;
using support::kImageFrame;
using support::View;

constexpr unsigned kSeeds = 30;

struct Sight {
  Matrix34 p;
  Vector4d q;
};

Sight random_sight(unsigned seed) {
  const View v = support::random_view(CameraModelId::kProjective, seed);
  return {Map<const Matrix34>(v.camera().data()), Vector4d(v.stored_point().data())};
}

Vector2d pixel(const Matrix34& p, const Vector4d& q) {
  const auto image = ProjectiveCamera::project<double>(p.data(), kImageFrame.data(), q.data());
  return {image.u, image.v};
}

Eigen::Matrix<double, 2, 3> point_jacobian(const Matrix34& p, const Vector4d& q) {
  LinearizedImagePoint<double, 12, 0> lin{};
  ProjectiveCamera::linearize(p.data(), kImageFrame.data(), q.data(), lin);
  return Map<const Eigen::Matrix<double, 2, 3, Eigen::RowMajor>>(&lin.point[0][0]);
}

Eigen::Matrix<double, 4, 3> tangent_basis(const Vector4d& q) {
  double basis[4][3];
  ProjectiveCamera::tangent_basis(q.data(), basis);
  return Map<const Eigen::Matrix<double, 4, 3, Eigen::RowMajor>>(&basis[0][0]);
}

Vector4d plus_point(const Vector4d& q, const Vector3d& delta) {
  Vector4d moved;
  ProjectiveCamera::plus_point(q.data(), delta.data(), moved.data());
  return moved;
}

Vector3d transport(const Vector4d& q, const Vector3d& step, const Vector4d& at) {
  Vector3d result;
  ProjectiveCamera::transport(q.data(), step.data(), at.data(), result.data());
  return result;
}

Vector3d random_step(unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0.0, 0.1);
  return {normal(random), normal(random), normal(random)};
}

TEST(ProjectiveCamera, SeesWhatTheCalibratedCameraSees) {
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const View v = support::random_view(CameraModelId::kCalibrated, seed);
    const auto image =
        CalibratedCamera::project<double>(v.camera().data(), v.intrinsics.data(), v.point.data());
    const auto [p, q] = random_sight(seed);
    EXPECT_LT((pixel(p, q) - Vector2d(image.u, image.v)).norm(), 1e-10);
  }
}

// In the trivial frame P is the matrix to pixels itself.
TEST(ProjectiveCamera, OfTheFrameOneZeroZeroIsTheMatrixToPixels) {
  const double frame[3] = {1.0, 0.0, 0.0};
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const auto [p, q] = random_sight(seed);
    const auto image = ProjectiveCamera::project<double>(p.data(), frame, q.data());
    const Vector2d expected = (p * q).hnormalized();
    EXPECT_LT((Vector2d(image.u, image.v) - expected).norm(), 1e-12 * (1.0 + expected.norm()));
  }
}

TEST(ProjectiveCamera, NeitherTheScaleOfTheMatrixNorThatOfThePointIsSeen) {
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const auto [p, q] = random_sight(seed);
    for (double scale : {-1.0, 1e-6, -37.0, 1e8}) {
      EXPECT_LT((pixel(scale * p, q) - pixel(p, q)).norm(), 1e-10);
      EXPECT_LT((pixel(p, scale * q) - pixel(p, q)).norm(), 1e-10);
    }
  }
}

TEST(ProjectiveCamera, AProjectiveTransformationOfTheWorldLeavesTheImageUnchanged) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const auto [p, q] = random_sight(seed);
    const Matrix4d h = Matrix4d::NullaryExpr([&] { return normal(random); });
    const Matrix34 moved = p * h.inverse();
    EXPECT_LT((pixel(moved, h * q) - pixel(p, q)).norm(), 1e-9);
  }
}

// The matrix has twelve numbers and the image sees eleven of them.
TEST(ProjectiveCamera, ItsJacobianDoesNotSeeTheScaleOfTheMatrix) {
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const auto [p, q] = random_sight(seed);
    LinearizedImagePoint<double, 12, 0> lin{};
    ProjectiveCamera::linearize(p.data(), kImageFrame.data(), q.data(), lin);
    const Map<const Eigen::Matrix<double, 2, 12, Eigen::RowMajor>> j(&lin.camera[0][0]);
    const Map<const VectorXd> along(p.data(), 12);
    EXPECT_LT((j * along).norm(), 1e-13 * j.norm());
  }
}

TEST(ProjectiveCamera, OnlyAPointInThePlaneOfTheCameraIsNotInTheImage) {
  Matrix34 canonical = Matrix34::Zero();
  canonical.leftCols<3>().setIdentity();
  const auto depth = [&](const Vector4d& q) {
    return ProjectiveCamera::project<double>(canonical.data(), kImageFrame.data(), q.data()).depth;
  };
  EXPECT_EQ(depth({0.0, 1.0, 0.0, 0.0}), 0.0);
  for (double w : {-2.0, -1e-3, 1e-3, 5.0}) EXPECT_GT(depth({1.0, 2.0, w, 1.0}), 0.0);
}

TEST(ProjectiveCamera, TangentsOfAPointAreAtRightAnglesToItAndOfItsNorm) {
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const Vector4d q = (0.1 + seed) * random_sight(seed).q;
    const auto basis = tangent_basis(q);
    EXPECT_LT((basis.transpose() * q).norm(), 1e-15 * q.squaredNorm());
    const Eigen::Matrix3d gram = basis.transpose() * basis / q.squaredNorm();
    EXPECT_LT((gram - Eigen::Matrix3d::Identity()).norm(), 1e-14);
  }
}

TEST(ProjectiveCamera, APointMovesAlongItsTangents) {
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const Vector4d q = random_sight(seed).q;
    const Vector3d delta = random_step(seed);
    EXPECT_LT((plus_point(q, delta) - (q + tangent_basis(q) * delta)).norm(), 1e-15);
  }
}

// A step is the same step whatever the scale of the coordinates it starts from.
TEST(ProjectiveCamera, APointOfAnotherScaleMovesToTheSamePlace) {
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const auto [p, q] = random_sight(seed);
    const Vector3d delta = random_step(seed);
    const Vector2d one = pixel(p, plus_point(q, delta)),
                   scaled = pixel(p, plus_point(-5 * q, delta));
    EXPECT_LT((one - scaled).norm(), 1e-9);
  }
}

// d/dα of the image of Q + α ΔQ is J, at where the line has come to, times the transported step.
TEST(ProjectiveCamera, TheImageMovesAlongALineAsTheTransportedStepSays) {
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const auto [p, q] = random_sight(seed);
    const Vector3d step = 0.2 * random_step(seed);
    for (double length : {0.0, 0.5, 1.0, -1.5}) {
      const auto line = [&, p = p, q = q](const VectorXd& further) -> VectorXd {
        return pixel(p, plus_point(q, (length + further[0]) * step));
      };
      const MatrixXd numeric = numeric_jacobian(line, VectorXd::Constant(1, 1e-3));
      const Vector4d at = plus_point(q, length * step);
      const Vector2d analytic = point_jacobian(p, at) * transport(q, step, at);
      EXPECT_LT((analytic - numeric).norm(), 1e-7 * numeric.norm()) << seed << ", " << length;
    }
  }
}

TEST(ProjectiveCamera, NormalisingGivesNormOneAndTheSameImage) {
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const auto [p, q] = random_sight(seed);
    Matrix34 camera = -30.0 * p;
    Vector4d point = 1e-5 * q;
    normalize_camera(CameraModelId::kProjective, camera.data());
    normalize_point(CameraModelId::kProjective, point.data());
    EXPECT_NEAR(camera.norm(), 1.0, 1e-15);
    EXPECT_NEAR(point.norm(), 1.0, 1e-15);
    EXPECT_LT((pixel(camera, point) - pixel(p, q)).norm(), 1e-10);
  }
}

}  // namespace
}  // namespace sfmcpp::projective_camera_test

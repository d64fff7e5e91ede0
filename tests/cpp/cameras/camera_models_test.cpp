// The camera models against published formulas and against one another.
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "sfmcpp/cameras/camera_model.hpp"
#include "sfmcpp/cameras/matrix34.hpp"
#include "sfmcpp/math/so3.hpp"
#include "support/camera_dispatch.hpp"
#include "support/random_views.hpp"

namespace sfmcpp::camera_models_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using support::View;

template <class Camera>
Vector2d pixel(const View& v, const std::vector<double>& intrinsics) {
  const auto image =
      Camera::template project<double>(v.camera().data(), intrinsics.data(), v.point.data());
  return {image.u, image.v};
}

constexpr std::array<double, kCameraStorage> kAtOrigin{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

// Computed with pycolmap 4.2.1, camera model FULL_OPENCV (OpenCV's rational model, k4 = k5 = k6 =
// 0) with fx 800, fy 816, c (320, 240), k1 −0.3, k2 0.12, p1 0.0015, p2 −0.0008, k3 −0.05.
TEST(PerspectiveCamera, ProjectsLikeOpenCv) {
  const std::vector<double> intrinsics{
      800, 1.02, 320, 240, 0, -0.3, 0.12, -0.05, 0, 0, 1.5e-3, -8e-4};
  const double cases[3][4] = {{0.31, -0.22, 557.454015008050, 68.223856774818},
                              {-0.4, 0.15, 15.872694250000, 356.507398449375},
                              {0.05, 0.45, 357.644089750000, 587.028079905000}};
  for (const auto& [x, y, u, v] : cases) {
    const double point[3] = {2.5 * x, 2.5 * y, 2.5};
    const auto image =
        PerspectiveCamera::project<double>(kAtOrigin.data(), intrinsics.data(), point);
    EXPECT_NEAR(image.u, u, 1e-9);
    EXPECT_NEAR(image.v, v, 1e-9);
  }
}

// At (x, y) = (0.5, 0): r² = 1/4, so that k4 and k5 scale x by k r⁸ = k / 256 and k r¹⁰ = k / 1024.
TEST(PerspectiveCamera, HigherRadialTermsScaleByTheEighthAndTenthPowerOfTheRadius) {
  const double point[3] = {0.5, 0.0, 1.0};
  for (const auto& [index, power] : {std::pair{8, 256.0}, std::pair{9, 1024.0}}) {
    std::vector<double> intrinsics{100, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
    intrinsics[index] = 0.64;
    const auto image =
        PerspectiveCamera::project<double>(kAtOrigin.data(), intrinsics.data(), point);
    EXPECT_NEAR(image.u, 50 * (1 + 0.64 / power), 1e-12);
  }
}

TEST(PerspectiveCamera, SkewAddsToTheColumnInProportionToTheDistortedHeight) {
  const double point[3] = {0.0, 0.5, 1.0};
  const std::vector<double> intrinsics{100, 2, 7, 9, 10, 0.4, 0, 0, 0, 0, 0, 0};
  const auto image = PerspectiveCamera::project<double>(kAtOrigin.data(), intrinsics.data(), point);
  const double y = 0.5 * (1 + 0.4 * 0.25);
  EXPECT_NEAR(image.u, 10 * y + 7, 1e-12);
  EXPECT_NEAR(image.v, 2 * 100 * y + 9, 1e-12);
}

TEST(PerspectiveCamera, WithoutPrincipalPointAndHigherTermsIsTheBalCamera) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const View v = support::random_view(CameraModelId::kBal, seed);
    const std::vector<double> perspective{700, 1, 0, 0, 0, -0.3, 0.2, 0, 0, 0, 0, 0};
    const Vector2d bal = pixel<BalCamera>(v, {700, -0.3, 0.2});
    EXPECT_LT((pixel<PerspectiveCamera>(v, perspective) - bal).norm(), 1e-11);
  }
}

TEST(CalibratedCamera, IsThePerspectiveCameraWithoutDistortion) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const View v = support::random_view(CameraModelId::kCalibrated, seed);
    const std::vector<double> perspective{700, 1.1, 300, 250, 3, 0, 0, 0, 0, 0, 0, 0};
    const Vector2d calibrated = pixel<CalibratedCamera>(v, {700, 1.1, 300, 250, 3});
    EXPECT_LT((pixel<PerspectiveCamera>(v, perspective) - calibrated).norm(), 1e-11);
  }
}

// grail.cs.washington.edu/projects/bal: P = R X + t; p = −P / P.z; p′ = f (1 + k1 |p|² + k2 |p|⁴)
// p, in a frame with y up and looking along −z: diag(1, −1, −1) times ours.
TEST(BalCamera, FollowsThePublishedFormulaInAFrameTurnedByHalfATurnAboutX) {
  const Vector3d flip(1, -1, -1);
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const View v = support::random_view(CameraModelId::kBal, seed);
    const Matrix3d r = flip.asDiagonal() * v.rotation.transpose();
    const Vector3d moved = r * v.point + -(r * v.centre);
    const Vector2d p = -moved.head<2>() / moved.z();
    const double n2 = p.squaredNorm();
    const Vector2d published = 700 * (1 - 0.3 * n2 + 0.2 * n2 * n2) * p;
    const Vector2d ours = pixel<BalCamera>(v, {700, -0.3, 0.2});
    EXPECT_LT((ours - Vector2d(published.x(), -published.y())).norm(), 1e-10);
  }
}

TEST(IntrinsicNames, ThereIsOneForEveryDerivativeOfTheModel) {
  EXPECT_EQ(intrinsic_names(CameraModelId::kPerspective).size(), PerspectiveCamera::kIntrinsics);
  EXPECT_EQ(intrinsic_names(CameraModelId::kBal).size(), BalCamera::kIntrinsics);
  EXPECT_FALSE(has_free_intrinsics(CameraModelId::kCalibrated));
  EXPECT_EQ(CalibratedCamera::kIntrinsics, 0);
  using Lens = PerspectiveLens;
  const auto names = intrinsic_names(CameraModelId::kPerspective);
  EXPECT_EQ(names[Lens::kAspect], "aspect");
  EXPECT_EQ(names[Lens::kSkew], "skew");
  EXPECT_EQ(names[Lens::kK1], "k1");
  EXPECT_EQ(names[Lens::kP2], "p2");
}

TEST(PlusPose, MultipliesTheRotationFromTheRightAndAddsToTheCentre) {
  const View v = support::random_view(CameraModelId::kBal, 3);
  const double delta[6] = {0.1, -0.2, 0.3, 1, 2, 3};
  std::array<double, kCameraStorage> moved;
  plus_pose(v.camera().data(), delta, moved.data());
  View expected = v;
  const Vector3d w(0.1, -0.2, 0.3);
  expected.rotation = v.rotation * Eigen::AngleAxisd(w.norm(), w.normalized()).toRotationMatrix();
  expected.centre += Vector3d(1, 2, 3);
  const auto stored = expected.camera();
  for (int k = 0; k < kCameraStorage; ++k) EXPECT_NEAR(moved[k], stored[k], 1e-14);
}

TEST(PlusPose, StaysARotationOverManySteps) {
  auto camera = support::random_view(CameraModelId::kBal, 4).camera();
  const double delta[6] = {0.7, -0.3, 0.4, 0, 0, 0};
  for (int k = 0; k < 10000; ++k) plus_pose(camera.data(), delta, camera.data());
  const PoseMatrixView pose(camera.data());
  const Matrix3d r = pose.leftCols<3>();
  EXPECT_LT((r * r.transpose() - Matrix3d::Identity()).norm(), 1e-14);
}

}  // namespace
}  // namespace sfmcpp::camera_models_test

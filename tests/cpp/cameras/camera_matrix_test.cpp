// What the algebraic line search asks of a camera model: its matrix to undistorted pixels, the
// change of that matrix along a step, and the pixels without distortion.
#include <array>
#include <cmath>
#include <random>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "sfmcpp/math/numeric_diff.hpp"
#include "support/camera_types.hpp"
#include "support/random_views.hpp"

namespace sfmcpp::camera_matrix_test {
namespace {

using Eigen::Vector2d;
using Eigen::Vector4d;
using Eigen::VectorXd;
using support::View;

template <class C>
class CameraMatrix : public testing::Test {
 protected:
  using Camera = typename C::Camera;
  static constexpr unsigned kSeeds = 30;
  using Delta = std::array<double, kMaxCameraTangent>;

  static View view(unsigned seed) { return support::random_view(C::kId, seed); }

  struct Line {
    Matrix34 matrix, change;
  };
  static Line line(const double* camera,
                   const std::vector<double>& intrinsics,
                   const Delta& delta = {},
                   const Delta& intrinsics_delta = {}) {
    MatrixAndChange out;
    Camera::matrix(camera, intrinsics.data(), delta.data(), intrinsics_delta.data(), out);
    return {Eigen::Map<const Matrix34>(out.matrix), Eigen::Map<const Matrix34>(out.change)};
  }

  static Vector4d homogeneous(const View& v) {
    const double no_step[3] = {0.0, 0.0, 0.0};
    Vector4d q, change;
    Camera::homogeneous(v.stored_point().data(), no_step, q.data(), change.data());
    EXPECT_EQ(change, Vector4d::Zero());
    return q;
  }

  static Vector2d undistort(const View& v, const Vector2d& seen) {
    Vector2d ideal;
    Camera::undistort(v.intrinsics.data(), seen[0], seen[1], ideal[0], ideal[1]);
    return ideal;
  }

  // A step of every unknown: tangent of the camera, and what of the intrinsics can be free.
  static void random_step(unsigned seed, Delta& delta, Delta& intrinsics_delta) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    delta = {};
    intrinsics_delta = {};
    for (int k = 0; k < Camera::kTangent; ++k) delta[k] = normal(random);
    for (int k = 0; k < Camera::kIntrinsics; ++k) intrinsics_delta[k] = normal(random);
  }

  static Matrix34 matrix_along(const View& v,
                               Delta delta,
                               const Delta& intrinsics_delta,
                               double h) {
    std::array<double, kCameraStorage> moved;
    for (double& d : delta) d *= h;
    Camera::plus(v.camera().data(), delta.data(), moved.data());
    std::vector<double> intrinsics = v.intrinsics;
    for (int k = 0; k < Camera::kIntrinsics; ++k) intrinsics[k] += h * intrinsics_delta[k];
    return line(moved.data(), intrinsics).matrix;
  }
};

TYPED_TEST_SUITE(CameraMatrix, support::CameraTypes, support::CameraTypeName);

TYPED_TEST(CameraMatrix, TakesThePointToItsImageWithoutDistortion) {
  using Type = typename TestFixture::Camera;
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    const View v = this->view(seed);
    const auto image = Type::template project<double>(
        v.camera().data(), v.intrinsics.data(), v.stored_point().data());
    const Vector2d by_matrix =
        (this->line(v.camera().data(), v.intrinsics).matrix * this->homogeneous(v)).hnormalized();
    EXPECT_LT((this->undistort(v, {image.u, image.v}) - by_matrix).norm(), 1e-9) << "seed " << seed;
  }
}

TYPED_TEST(CameraMatrix, WithoutAStepDoesNotChange) {
  const View v = this->view(3);
  EXPECT_EQ(this->line(v.camera().data(), v.intrinsics).change, Matrix34::Zero());
}

// ΔP is the derivative of the matrix along the step, intrinsics included.
TYPED_TEST(CameraMatrix, ChangeIsTheDerivativeAlongTheStep) {
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    const View v = this->view(seed);
    typename TestFixture::Delta delta, intrinsics_delta;
    this->random_step(seed, delta, intrinsics_delta);
    const auto along = [&](const VectorXd& h) -> VectorXd {
      return this->matrix_along(v, delta, intrinsics_delta, h[0]).reshaped();
    };
    const VectorXd numeric = numeric_jacobian(along, VectorXd::Constant(1, 1e-3));
    const VectorXd analytic =
        this->line(v.camera().data(), v.intrinsics, delta, intrinsics_delta).change.reshaped();
    EXPECT_LT((analytic - numeric).norm(), 1e-7 * numeric.norm()) << "seed " << seed;
  }
}

// What is left out of P + h ΔP is of second order: a quarter of it at half the step.
TYPED_TEST(CameraMatrix, WhatTheChangeLeavesOutIsOfSecondOrder) {
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    const View v = this->view(seed);
    typename TestFixture::Delta delta, intrinsics_delta;
    this->random_step(seed, delta, intrinsics_delta);
    const auto [matrix, change] =
        this->line(v.camera().data(), v.intrinsics, delta, intrinsics_delta);
    const auto rest = [&, &p = matrix, &dp = change](double h) {
      return (this->matrix_along(v, delta, intrinsics_delta, h) - p - h * dp).norm();
    };
    const double whole = rest(2e-3), half = rest(1e-3);
    if (TestFixture::Camera::kMetric) {
      EXPECT_NEAR(whole / half, 4.0, 0.05) << "seed " << seed;
    } else {
      EXPECT_LT(rest(1.0), 1e-14 * (matrix.norm() + change.norm())) << "the update is additive";
    }
  }
}

// Beyond the range of the strong lenses here, and where the image of the lens folds back.
TYPED_TEST(CameraMatrix, UndistortedPixelsAreFiniteEverywhere) {
  const View v = this->view(1);
  for (double u = -20000.0; u <= 20000.0; u += 500.0) {
    for (double w = -20000.0; w <= 20000.0; w += 500.0) {
      EXPECT_TRUE(this->undistort(v, {u, w}).allFinite()) << u << ", " << w;
    }
  }
}

// r (1 − 0.3 r²) has its largest value, 0.7027, at r = 1.054; beyond, nothing on this side of the
// axis is seen, and what Newton's method may find on the other side is no answer.
TEST(Undistorted, IsThePreimageWithinTheRangeOfTheLensAndTheGuessBeyond) {
  const double intrinsics[3] = {700.0, -0.3, 0.0};
  const auto undistorted_radius = [&](double distorted) {
    double x, y;
    undistorted<kExactly, BalLens>(
        intrinsics, 700.0 * 0.8 * distorted, -700.0 * 0.6 * distorted, x, y);
    EXPECT_NEAR(0.6 * x, -0.8 * y, 1e-12);
    return 0.8 * x - 0.6 * y;
  };
  for (double r = 0.01; r < 0.85; r += 0.01)
    EXPECT_NEAR(undistorted_radius(r * (1.0 - 0.3 * r * r)), r, 1e-8);
  for (double r = 0.72; r < 20.0; r += 0.01) EXPECT_NEAR(undistorted_radius(r), r, 1e-12);
}

// A lens like those of phones: corner of an image of 4000 × 3000 pixels at f = 3000.
TEST(Undistorted, TwoStepsComeWithinAHundredthOfAPixelWithAnOrdinaryLens) {
  const double intrinsics[3] = {3000.0, -0.12, 0.05};
  for (double u = -2000.0; u <= 2000.0; u += 100.0) {
    for (double v = -1500.0; v <= 1500.0; v += 100.0) {
      Vector2d exact, close;
      BalCamera::undistort(intrinsics, u, v, exact[0], exact[1]);
      BalCamera::undistort<2>(intrinsics, u, v, close[0], close[1]);
      EXPECT_LT((close - exact).norm(), 0.01) << u << ", " << v;
    }
  }
}

}  // namespace
}  // namespace sfmcpp::camera_matrix_test

// Laws that every camera model keeps; add a model to `Models` and it is tested.
#include <array>

#include <Eigen/Core>
#include <gtest/gtest.h>

#include "sfmcpp/cameras/bal.hpp"
#include "sfmcpp/cameras/calibrated.hpp"
#include "sfmcpp/cameras/perspective.hpp"
#include "sfmcpp/core/simd.hpp"
#include "sfmcpp/math/numeric_diff.hpp"
#include "sfmcpp/math/so3.hpp"
#include "support/random_views.hpp"

namespace sfmcpp {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;
using support::View;

template <class CameraType, CameraModelId kModel>
struct Model {
  using Camera = CameraType;
  static constexpr CameraModelId kId = kModel;
};

template <class M>
class CameraLaws : public testing::Test {
 protected:
  using Camera = typename M::Camera;
  static constexpr int kIntrinsics = Camera::kIntrinsics;
  static constexpr int kSeeds = 30;

  static View view(unsigned seed) { return support::random_view(M::kId, seed); }

  static ImagePoint<double> image(const View& v) {
    return Camera::template project<double>(v.camera().data(), v.intrinsics.data(), v.point.data());
  }
  static Vector2d pixel(const View& v) {
    const ImagePoint<double> p = image(v);
    return {p.u, p.v};
  }

  // 2 × (6 + kIntrinsics + 3): pose, intrinsics, point.
  static MatrixXd analytic(const View& v) {
    LinearizedImagePoint<double, Camera::kTangent, kIntrinsics> lin{};
    Camera::linearize(v.camera().data(), v.intrinsics.data(), v.point.data(), lin);
    MatrixXd jacobian(2, kPoseTangent + kIntrinsics + 3);
    for (int row = 0; row < 2; ++row) {
      for (int k = 0; k < kPoseTangent; ++k) jacobian(row, k) = lin.camera[row][k];
      for (int k = 0; k < kIntrinsics; ++k) jacobian(row, 6 + k) = lin.intrinsics[row][k];
      for (int k = 0; k < 3; ++k) jacobian(row, 6 + kIntrinsics + k) = lin.point[row][k];
    }
    return jacobian;
  }

  static VectorXd moved_pixel(const View& v, const VectorXd& delta) {
    std::array<double, kCameraStorage> camera;
    plus_pose(v.camera().data(), delta.data(), camera.data());
    std::vector<double> intrinsics = v.intrinsics;
    for (int k = 0; k < kIntrinsics; ++k) intrinsics[k] += delta[6 + k];
    const Vector3d point = v.point + delta.tail<3>();
    const auto p = Camera::template project<double>(camera.data(), intrinsics.data(), point.data());
    return Vector2d(p.u, p.v);
  }
};

using Models = testing::Types<Model<CalibratedCamera, CameraModelId::kCalibrated>,
                              Model<PerspectiveCamera, CameraModelId::kPerspective>,
                              Model<BalCamera, CameraModelId::kBal>>;
TYPED_TEST_SUITE(CameraLaws, Models);

TYPED_TEST(CameraLaws, AnalyticJacobianIsTheNumericOne) {
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    const View v = this->view(seed);
    const MatrixXd analytic = this->analytic(v);
    const auto f = [&](const VectorXd& delta) { return this->moved_pixel(v, delta); };
    VectorXd steps = VectorXd::Constant(analytic.cols(), 1e-3);
    // The projection is linear in each intrinsic parameter alone: a long step costs nothing.
    steps.segment(6, this->kIntrinsics).setOnes();
    const MatrixXd numeric = numeric_jacobian(f, steps);
    for (int k = 0; k < analytic.cols(); ++k) {
      const double error = (analytic.col(k) - numeric.col(k)).norm();
      EXPECT_LT(error, 1e-7 * numeric.col(k).norm()) << "column " << k << ", seed " << seed;
    }
  }
}

TYPED_TEST(CameraLaws, LinearizeProjectsLikeProject) {
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    using Type = typename TestFixture::Camera;
    const View v = this->view(seed);
    LinearizedImagePoint<double, 6, Type::kIntrinsics> lin{};
    Type::linearize(v.camera().data(), v.intrinsics.data(), v.point.data(), lin);
    EXPECT_DOUBLE_EQ(lin.image.u, this->image(v).u);
    EXPECT_DOUBLE_EQ(lin.image.v, this->image(v).v);
    EXPECT_DOUBLE_EQ(lin.image.depth, this->image(v).depth);
  }
}

TYPED_TEST(CameraLaws, MovingCentreAndPointTogetherLeavesTheImageUnchanged) {
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    View v = this->view(seed);
    const MatrixXd j = this->analytic(v);
    EXPECT_EQ((j.middleCols(3, 3) + j.rightCols(3)).cwiseAbs().maxCoeff(), 0.0);
    const Vector2d before = this->pixel(v);
    const Vector3d shift(3, -4, 5);
    v.centre += shift;
    v.point += shift;
    EXPECT_LT((this->pixel(v) - before).norm(), 1e-10);
  }
}

TYPED_TEST(CameraLaws, ScalingAboutTheCentreLeavesTheImageUnchanged) {
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    View v = this->view(seed);
    const MatrixXd j = this->analytic(v);
    const Vector3d ray = v.point - v.centre;
    EXPECT_LT((j.rightCols(3) * ray).norm(), 1e-13 * j.rightCols(3).norm() * ray.norm());
    const Vector2d before = this->pixel(v);
    v.point = v.centre + 2.5 * ray;
    EXPECT_LT((this->pixel(v) - before).norm(), 1e-10);
  }
}

// δR = w turns the camera by the world vector R w about its centre; the point turns with it.
TYPED_TEST(CameraLaws, TurningCameraAndPointTogetherLeavesTheImageUnchanged) {
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    const View v = this->view(seed);
    const MatrixXd j = this->analytic(v);
    const Eigen::Matrix3d point_turn = -skew(v.point - v.centre) * v.rotation;
    const MatrixXd sum = j.leftCols(3) + j.rightCols(3) * point_turn;
    EXPECT_LT(sum.norm(), 1e-13 * j.leftCols(3).norm());
  }
}

TYPED_TEST(CameraLaws, RotatingTheWholeWorldLeavesTheImageUnchanged) {
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    View v = this->view(seed);
    const Vector2d before = this->pixel(v);
    const Eigen::Matrix3d turn = exp_so3(Vector3d(1.0, -0.3, 0.8));
    v.rotation = turn * v.rotation;
    v.centre = turn * v.centre;
    v.point = turn * v.point;
    EXPECT_LT((this->pixel(v) - before).norm(), 1e-10);
  }
}

TYPED_TEST(CameraLaws, DepthIsTheDistanceAlongTheAxisNegativeBehind) {
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    View v = this->view(seed);
    const Vector3d axis = v.rotation.col(2);
    EXPECT_NEAR(this->image(v).depth, axis.dot(v.point - v.centre), 1e-12);
    EXPECT_GT(this->image(v).depth, 0.0);
    v.point = 2 * v.centre - v.point;
    EXPECT_LT(this->image(v).depth, 0.0);
  }
}

// Two lanes only: wider packs belong to translation units of their instruction set (core/isa.hpp),
// and are compared with `double` through the kernels, in residuals/reprojection_kernels_test.cpp.
TYPED_TEST(CameraLaws, APackComputesLikeOneDoubleInEachLane) {
  using Type = typename TestFixture::Camera;
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    const View a = this->view(seed);
    View b = a;
    b.point = a.point + 0.3 * a.rotation.col(0);
    Pack<2> point[3];
    for (int k = 0; k < 3; ++k) {
      const double lanes[2] = {a.point[k], b.point[k]};
      point[k] = load<2>(lanes);
    }
    LinearizedImagePoint<Pack<2>, 6, Type::kIntrinsics> packed{};
    Type::linearize(a.camera().data(), a.intrinsics.data(), point, packed);
    const View* lane_view[2] = {&a, &b};
    for (int lane = 0; lane < 2; ++lane) {
      const MatrixXd j = this->analytic(*lane_view[lane]);
      const double tolerance = 1e-13 * j.cwiseAbs().maxCoeff();
      EXPECT_NEAR(packed.image.u[lane], this->image(*lane_view[lane]).u, 1e-10);
      for (int row = 0; row < 2; ++row) {
        for (int k = 0; k < 6; ++k) EXPECT_NEAR(packed.camera[row][k][lane], j(row, k), tolerance);
        for (int k = 0; k < Type::kIntrinsics; ++k) {
          EXPECT_NEAR(packed.intrinsics[row][k][lane], j(row, 6 + k), tolerance);
        }
      }
    }
  }
}

}  // namespace
}  // namespace sfmcpp

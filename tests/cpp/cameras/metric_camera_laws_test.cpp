// Laws of cameras that are a pose [R | c] in a Euclidean world.
#include <Eigen/Core>
#include <gtest/gtest.h>

#include "sfmcpp/math/so3.hpp"
#include "support/camera_types.hpp"
#include "support/random_views.hpp"

namespace sfmcpp::metric_camera_laws_test {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using support::View;
using Jacobian = Eigen::Matrix<double, 2, 3>;

template <class C>
class MetricCameraLaws : public testing::Test {
 protected:
  using Camera = typename C::Camera;
  static constexpr int kSeeds = 30;

  static View view(unsigned seed) { return support::random_view(C::kId, seed); }

  static ImagePoint<double> image(const View& v) {
    return Camera::template project<double>(v.camera().data(), v.intrinsics.data(), v.point.data());
  }
  static Vector2d pixel(const View& v) {
    const ImagePoint<double> p = image(v);
    return {p.u, p.v};
  }

  struct Derivatives {
    Jacobian rotation, centre, point;
  };
  static Derivatives analytic(const View& v) {
    LinearizedImagePoint<double, kPoseTangent, Camera::kIntrinsics> lin{};
    Camera::linearize(v.camera().data(), v.intrinsics.data(), v.point.data(), lin);
    Derivatives d;
    for (int row = 0; row < 2; ++row) {
      for (int k = 0; k < 3; ++k) {
        d.rotation(row, k) = lin.camera[row][k];
        d.centre(row, k) = lin.camera[row][3 + k];
        d.point(row, k) = lin.point[row][k];
      }
    }
    return d;
  }
};

TYPED_TEST_SUITE(MetricCameraLaws, support::MetricCameraTypes, support::CameraTypeName);

TYPED_TEST(MetricCameraLaws, MovingCentreAndPointTogetherLeavesTheImageUnchanged) {
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    View v = this->view(seed);
    const auto j = this->analytic(v);
    EXPECT_EQ((j.centre + j.point).cwiseAbs().maxCoeff(), 0.0);
    const Vector2d before = this->pixel(v);
    const Vector3d shift(3, -4, 5);
    v.centre += shift;
    v.point += shift;
    EXPECT_LT((this->pixel(v) - before).norm(), 1e-10);
  }
}

TYPED_TEST(MetricCameraLaws, ScalingAboutTheCentreLeavesTheImageUnchanged) {
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    View v = this->view(seed);
    const Jacobian j = this->analytic(v).point;
    const Vector3d ray = v.point - v.centre;
    EXPECT_LT((j * ray).norm(), 1e-13 * j.norm() * ray.norm());
    const Vector2d before = this->pixel(v);
    v.point = v.centre + 2.5 * ray;
    EXPECT_LT((this->pixel(v) - before).norm(), 1e-10);
  }
}

// δR = w turns the camera by the world vector R w about its centre; the point turns with it.
TYPED_TEST(MetricCameraLaws, TurningCameraAndPointTogetherLeavesTheImageUnchanged) {
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    const View v = this->view(seed);
    const auto j = this->analytic(v);
    const Eigen::Matrix3d point_turn = -skew(v.point - v.centre) * v.rotation;
    const Jacobian sum = j.rotation + j.point * point_turn;
    EXPECT_LT(sum.norm(), 1e-13 * j.rotation.norm());
  }
}

TYPED_TEST(MetricCameraLaws, RotatingTheWholeWorldLeavesTheImageUnchanged) {
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

TYPED_TEST(MetricCameraLaws, DepthIsTheDistanceAlongTheAxisNegativeBehind) {
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    View v = this->view(seed);
    const Vector3d axis = v.rotation.col(2);
    EXPECT_NEAR(this->image(v).depth, axis.dot(v.point - v.centre), 1e-12);
    EXPECT_GT(this->image(v).depth, 0.0);
    v.point = 2 * v.centre - v.point;
    EXPECT_LT(this->image(v).depth, 0.0);
  }
}

TYPED_TEST(MetricCameraLaws, NormalisingChangesNoBit) {
  const View v = this->view(1);
  auto camera = v.camera();
  std::vector<double> point = v.stored_point();
  normalize_camera(TypeParam::kId, camera.data());
  normalize_point(TypeParam::kId, point.data());
  EXPECT_EQ(camera, v.camera());
  EXPECT_EQ(point, v.stored_point());
}

}  // namespace
}  // namespace sfmcpp::metric_camera_laws_test

// Laws that every camera model keeps.
#include <array>
#include <cmath>
#include <limits>

#include <Eigen/Core>
#include <gtest/gtest.h>

#include "sfmcpp/core/simd.hpp"
#include "sfmcpp/math/numeric_diff.hpp"
#include "support/camera_types.hpp"
#include "support/random_views.hpp"

namespace sfmcpp::camera_laws_test {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;
using support::View;

template <class C>
class CameraLaws : public testing::Test {
 protected:
  using Camera = typename C::Camera;
  static constexpr int kTangent = Camera::kTangent;
  static constexpr int kIntrinsics = Camera::kIntrinsics;
  static constexpr int kColumns = kTangent + kIntrinsics + kPointTangent;
  static constexpr int kSeeds = 30;
  using Linearized = LinearizedImagePoint<double, kTangent, kIntrinsics>;

  static View view(unsigned seed) { return support::random_view(C::kId, seed); }

  static ImagePoint<double> image(const View& v) {
    return Camera::template project<double>(
        v.camera().data(), v.intrinsics.data(), v.stored_point().data());
  }
  static Linearized linearized(const View& v) {
    Linearized lin{};
    Camera::linearize(v.camera().data(), v.intrinsics.data(), v.stored_point().data(), lin);
    return lin;
  }

  // 2 × kColumns: camera, intrinsics, point.
  static MatrixXd analytic(const View& v) {
    const Linearized lin = linearized(v);
    MatrixXd jacobian(2, kColumns);
    for (int row = 0; row < 2; ++row) {
      for (int k = 0; k < kTangent; ++k) jacobian(row, k) = lin.camera[row][k];
      for (int k = 0; k < kIntrinsics; ++k) jacobian(row, kTangent + k) = lin.intrinsics[row][k];
      for (int k = 0; k < kPointTangent; ++k)
        jacobian(row, kTangent + kIntrinsics + k) = lin.point[row][k];
    }
    return jacobian;
  }

  static VectorXd moved_pixel(const View& v, const VectorXd& delta) {
    std::array<double, kCameraStorage> camera;
    std::array<double, kMaxPointStorage> point;
    std::vector<double> intrinsics = v.intrinsics;
    Camera::plus(v.camera().data(), delta.data(), camera.data());
    for (int k = 0; k < kIntrinsics; ++k) intrinsics[k] += delta[kTangent + k];
    Camera::plus_point(v.stored_point().data(), delta.tail<3>().data(), point.data());
    const auto p = Camera::template project<double>(camera.data(), intrinsics.data(), point.data());
    return Vector2d(p.u, p.v);
  }

  // Long enough for little rounding, short against the units of the unknowns: metres and radians,
  // or coordinates of norm one. The projections of sfmcpp are linear in each intrinsic parameter
  // alone; a plug-in need not be.
  static VectorXd steps() {
    VectorXd steps = VectorXd::Constant(kColumns, Camera::kMetric ? 1e-3 : 1e-4);
    if (C::kId != CameraModelId::kPlugin) steps.segment(kTangent, kIntrinsics).setOnes();
    return steps;
  }
  // Of a numeric derivative, by rounding of the pixels.
  static double rounding(const View& v, int column) {
    const double pixel = std::hypot(image(v).u, image(v).v);
    return 8.0 * std::numeric_limits<double>::epsilon() * pixel / steps()[column];
  }
};

TYPED_TEST_SUITE(CameraLaws, support::CameraAndFunctionTypes, support::CameraTypeName);

TYPED_TEST(CameraLaws, AnalyticJacobianIsTheNumericOne) {
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    const View v = this->view(seed);
    const MatrixXd analytic = this->analytic(v);
    const auto f = [&](const VectorXd& delta) { return this->moved_pixel(v, delta); };
    const MatrixXd numeric = numeric_jacobian(f, this->steps());
    for (int k = 0; k < analytic.cols(); ++k) {
      const double error = (analytic.col(k) - numeric.col(k)).norm();
      const double allowed = 1e-7 * numeric.col(k).norm() + this->rounding(v, k);
      EXPECT_LT(error, allowed) << "column " << k << ", seed " << seed;
    }
  }
}

TYPED_TEST(CameraLaws, LinearizeProjectsLikeProject) {
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    const View v = this->view(seed);
    const auto lin = this->linearized(v);
    EXPECT_DOUBLE_EQ(lin.image.u, this->image(v).u);
    EXPECT_DOUBLE_EQ(lin.image.v, this->image(v).v);
    EXPECT_DOUBLE_EQ(lin.image.depth, this->image(v).depth);
  }
}

// The functions by name, which know the model when the program runs, are those of the type.
TYPED_TEST(CameraLaws, FunctionsByNameAreThoseOfTheType) {
  using Type = typename TestFixture::Camera;
  const View v = this->view(1);
  const std::array<double, 12> delta{.1, -.2, .3, .4, -.5, .6, .7, .8, -.9, 1., 1.1, -1.2};
  std::array<double, kCameraStorage> camera, by_name;
  Type::plus(v.camera().data(), delta.data(), camera.data());
  plus_camera(TypeParam::kId, v.camera().data(), delta.data(), by_name.data());
  EXPECT_EQ(camera, by_name);
  std::vector<double> point = v.stored_point(), point_by_name = point;
  ASSERT_EQ(static_cast<int>(point.size()), point_storage(TypeParam::kId));
  Type::plus_point(v.stored_point().data(), delta.data(), point.data());
  plus_point(TypeParam::kId, v.stored_point().data(), delta.data(), point_by_name.data());
  EXPECT_EQ(point, point_by_name);
  EXPECT_EQ(camera_tangent(TypeParam::kId), Type::kTangent);
  EXPECT_LE(Type::kTangent, kMaxCameraTangent);
  EXPECT_LE(Type::kPointStorage, kMaxPointStorage);
}

template <class C>
class CompiledCameraLaws : public CameraLaws<C> {};

TYPED_TEST_SUITE(CompiledCameraLaws, support::CameraTypes, support::CameraTypeName);

// Two lanes only: wider packs belong to translation units of their instruction set (core/isa.hpp),
// and are compared with `double` through the kernels, in residuals/reprojection_kernels_test.cpp.
TYPED_TEST(CompiledCameraLaws, APackComputesLikeOneDoubleInEachLane) {
  using Type = typename TestFixture::Camera;
  for (unsigned seed = 1; seed <= this->kSeeds; ++seed) {
    const View a = this->view(seed);
    View b = a;
    b.point = a.point + 0.3 * a.rotation.col(0);
    Pack<2> point[Type::kPointStorage];
    for (int k = 0; k < Type::kPointStorage; ++k) {
      const double lanes[2] = {a.stored_point()[k], b.stored_point()[k]};
      point[k] = load<2>(lanes);
    }
    LinearizedImagePoint<Pack<2>, Type::kTangent, Type::kIntrinsics> packed{};
    Type::linearize(a.camera().data(), a.intrinsics.data(), point, packed);
    const View* lane_view[2] = {&a, &b};
    for (int lane = 0; lane < 2; ++lane) {
      const MatrixXd j = this->analytic(*lane_view[lane]);
      const double tolerance = 1e-13 * j.cwiseAbs().maxCoeff();
      EXPECT_NEAR(packed.image.u[lane], this->image(*lane_view[lane]).u, 1e-10);
      for (int row = 0; row < 2; ++row) {
        for (int k = 0; k < Type::kTangent; ++k)
          EXPECT_NEAR(packed.camera[row][k][lane], j(row, k), tolerance);
        for (int k = 0; k < Type::kIntrinsics; ++k)
          EXPECT_NEAR(packed.intrinsics[row][k][lane], j(row, Type::kTangent + k), tolerance);
        for (int k = 0; k < kPointTangent; ++k)
          EXPECT_NEAR(packed.point[row][k][lane], j.rightCols(3)(row, k), tolerance);
      }
    }
  }
}

}  // namespace
}  // namespace sfmcpp::camera_laws_test

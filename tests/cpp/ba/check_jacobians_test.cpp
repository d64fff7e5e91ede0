#include "sfmcpp/ba/check_jacobians.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <gtest/gtest.h>

#include "sfmcpp/core/error.hpp"
#include "support/all_models.hpp"
#include "support/small_scenes.hpp"

namespace sfmcpp::ba::check_jacobians_test {
namespace {

class CheckJacobians : public testing::TestWithParam<CameraModelId> {
 protected:
  support::OwnedProblem scene = make_circle_scene(support::perturbed(GetParam()));
  int columns() const {
    const int intrinsics = has_free_intrinsics(GetParam()) ? scene.view().num_intrinsics() : 0;
    return camera_tangent(GetParam()) + intrinsics + 3;
  }
};

TEST_P(CheckJacobians, AnalyticDerivativesAgreeWithNumericOnes) {
  const JacobianCheck check = check_jacobians(scene.view());
  EXPECT_LT(check.worst_error, 1e-7) << check.worst_parameter << " of " << check.worst_observation;
  EXPECT_GT(check.worst_error, 0.0) << "nothing was compared";
}

TEST_P(CheckJacobians, EveryParameterOfEveryObservationIsComparedUpToTheLimit) {
  EXPECT_EQ(check_jacobians(scene.view()).entries, 240L * 2 * columns());
  EXPECT_EQ(check_jacobians(scene.view(), 50).entries, 50L * 2 * columns());
}

// There the numeric derivatives by the higher terms of a distortion are rounding, or zero.
TEST(CheckJacobiansOf, OneObservationNearTheAxisAgreesWithItself) {
  for (double aside : {0.0, 1e-5, 1e-3, 0.05, 0.1}) {
    support::OwnedProblem scene;
    scene.camera_model = CameraModelId::kPerspective;
    scene.cameras = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    scene.intrinsics = {500, 1, 320, 240, 0, 0.1, 0.01, 0, 0, 0};
    scene.intrinsics.resize(intrinsic_names(scene.camera_model).size());
    scene.points = {aside, 0.7 * aside, 4};
    scene.intrinsics_index = {0};
    scene.observe(0, 0, 320 + 125 * aside, 240 + 87.5 * aside);
    const JacobianCheck check = check_jacobians(scene.view());
    EXPECT_LT(check.worst_error, 1e-7) << check.worst_parameter << ", " << aside;
  }
}

// A pinhole that sees as far as `edge` beside its axis, with a derivative that is off in the first
// point: the images of those beyond are no numbers, as numeric derivatives of those at the edge.
class Narrow final : public CameraFunction {
 public:
  const std::string& name() const override { return name_; }
  std::span<const std::string_view> intrinsic_names() const override { return names_; }
  void image(int count,
             const double* points,
             const double* f,
             double* pixels,
             const Jacobians* out) const override {
    for (int k = 0; k < count; ++k, points += 3) {
      const double x = points[0] / points[2], y = points[1] / points[2];
      pixels[2 * k] = points[0] > 1.0 ? NAN : f[k] * x;
      pixels[2 * k + 1] = f[k] * y;
      if (out == nullptr) continue;
      const double scale = f[k] / points[2], off = points[0] == 0.0 ? 1.1 : 1.0;
      const double by_point[6] = {off * scale, 0, -scale * x, 0, scale, -scale * y};
      std::copy_n(by_point, 6, out->by_point + 6 * k);
      out->by_intrinsics[2 * k] = x;
      out->by_intrinsics[2 * k + 1] = y;
    }
  }

 private:
  std::string name_ = "narrow";
  std::array<std::string_view, 1> names_{"f"};
};

TEST(CheckJacobiansOf, AFunctionWithoutANumberIsNamedWhereverItIs) {
  const Narrow narrow;
  support::OwnedProblem scene;
  scene.cameras = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  scene.intrinsics = {500};
  scene.intrinsics_index = {0};
  scene.points = {0, 0.2, 4, 0.5, -0.3, 5, 1, 0.1, 4, -0.7, 0.2, 6};
  for (int p = 0; p < 4; ++p) scene.observe(0, p, 0, 0);
  Problem problem = scene.view();
  problem.camera_model = CameraModel(narrow);
  const JacobianCheck check = check_jacobians(problem);
  EXPECT_EQ(check.worst_observation, 2);  // at the edge
  EXPECT_EQ(check.worst_error, HUGE_VAL);
  const JacobianCheck of_first = check_jacobians(problem, 2);  // of observations 0 and 2
  EXPECT_EQ(of_first.worst_observation, 2);
  scene.points[6] = 0.9;
  EXPECT_EQ(check_jacobians(problem).worst_observation, 0);
  EXPECT_NEAR(check_jacobians(problem).worst_error, 0.1, 1e-3);
}

// Nothing is behind an uncalibrated camera.
class CheckMetricJacobians : public CheckJacobians {};

TEST_P(CheckMetricJacobians, ObservationsBehindTheirCameraAreLeftOut) {
  for (int k = 0; k < 3; ++k) scene.points[k] = 1.5 * scene.cameras[12 * 2 + 4 * k + 3];
  EXPECT_LT(check_jacobians(scene.view()).entries, 240L * 2 * columns());
}

TEST_P(CheckJacobians, ABrokenProblemIsRefused) {
  scene.camera_index[3] = 77;
  EXPECT_THROW(check_jacobians(scene.view()), InvalidArgument);
}

INSTANTIATE_TEST_SUITE_P(Models,
                         CheckJacobians,
                         testing::ValuesIn(support::all_models()),
                         support::name_of_model);
INSTANTIATE_TEST_SUITE_P(Models,
                         CheckMetricJacobians,
                         testing::ValuesIn(support::metric_models()),
                         support::name_of_model);

}  // namespace
}  // namespace sfmcpp::ba::check_jacobians_test

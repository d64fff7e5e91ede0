#include "sfmcpp/ba/check_jacobians.hpp"

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

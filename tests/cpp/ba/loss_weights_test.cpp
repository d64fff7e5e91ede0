// What a robust loss makes of the normal equations, against the dense Jacobian of the cameras.
#include <gtest/gtest.h>

#include "support/all_models.hpp"
#include "support/dense_reference.hpp"

namespace sfmcpp::ba::loss_weights_test {
namespace {

class LossWeightsOf : public testing::TestWithParam<CameraModelId> {
 protected:
  static support::OwnedProblem scene() {
    support::SceneOptions options = support::perturbed(GetParam());
    options.varied_sigma = true;
    options.num_groups = 2;
    options.window = 4;
    options.num_points = 30;
    support::OwnedProblem result = make_circle_scene(options);
    result.fixed_cameras[1] = result.fixed_points[3] = 1;
    return result;
  }
  support::LinearizedProblem linearized{scene()};
};

TEST_P(LossWeightsOf, ResidualAndJacobianAreWeightedByTheRootOfItsDerivative) {
  for (LossKind kind :
       {LossKind::kSquared, LossKind::kHuber, LossKind::kCauchy, LossKind::kTukey}) {
    const Loss loss{kind, 5.0};
    linearized.model.set_loss(loss);
    linearized.model.linearize(linearized.state);
    const support::DenseSystem weighted = make_dense_system(linearized, loss);
    const Eigen::VectorXd expected = weighted.jacobian.transpose() * weighted.residual;
    const linear::NormalEquations& normal = linearized.normal();
    ASSERT_EQ(static_cast<int>(normal.camera_rhs().size()), weighted.camera_columns);
    for (int k = 0; k < weighted.camera_columns; ++k) {
      EXPECT_NEAR(normal.camera_rhs()[k], expected[k], 1e-12 * expected.cwiseAbs().maxCoeff());
    }
    EXPECT_NEAR(normal.gradient_max_norm() / expected.cwiseAbs().maxCoeff(), 1.0, 1e-12);
  }
}

INSTANTIATE_TEST_SUITE_P(Models,
                         LossWeightsOf,
                         testing::ValuesIn(support::all_models()),
                         support::name_of_model);

}  // namespace
}  // namespace sfmcpp::ba::loss_weights_test

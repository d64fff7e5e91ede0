#include "sfmcpp/linear/normal_equations.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "support/all_models.hpp"
#include "support/block_diagonal.hpp"

namespace sfmcpp::linear {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using support::DenseSystem;
using support::LinearizedProblem;

class NormalEquationsOf : public testing::TestWithParam<CameraModelId> {
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
  LinearizedProblem linearized{scene()};
  DenseSystem dense = make_dense_system(linearized);
  const NormalEquations& normal = linearized.normal();
  VectorXd gradient = dense.jacobian.transpose() * dense.residual;
  VectorXd diagonal = dense.jacobian.colwise().squaredNorm();
};

TEST_P(NormalEquationsOf, RightHandSideAndDiagonalOfTheCamerasAreThoseOfTheDenseJacobian) {
  ASSERT_EQ(static_cast<int>(normal.camera_rhs().size()), dense.camera_columns);
  const double tolerance = 1e-12 * gradient.cwiseAbs().maxCoeff();
  for (int k = 0; k < dense.camera_columns; ++k) {
    EXPECT_NEAR(normal.camera_rhs()[k], gradient[k], tolerance);
    EXPECT_NEAR(normal.camera_diagonal()[k], diagonal[k], 1e-12 * diagonal[k]);
  }
}

TEST_P(NormalEquationsOf, PointBlocksAreThoseOfTheDenseJacobian) {
  for (int p = 0; p < linearized.graph.num_points; ++p) {
    MatrixXd v = MatrixXd::Zero(3, 3);
    VectorXd b = VectorXd::Zero(3);
    if (dense.point_column[p] >= 0) {
      const MatrixXd jp = dense.jacobian.middleCols(dense.point_column[p], 3);
      v = jp.transpose() * jp;
      b = jp.transpose() * dense.residual;
    }
    const PointBlock& block = normal.point_block(p);
    MatrixXd lower(3, 3);
    lower << block.v00, 0, 0, block.v10, block.v11, 0, block.v20, block.v21, block.v22;
    const MatrixXd difference = lower - MatrixXd(v.triangularView<Eigen::Lower>());
    EXPECT_LE(difference.cwiseAbs().maxCoeff(), 1e-12 * v.norm());
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(block.rhs[k], b[k], 1e-12 * gradient.norm());
  }
}

TEST_P(NormalEquationsOf, NormsAreThoseOfAllUnknownsTogether) {
  EXPECT_NEAR(normal.gradient_max_norm() / gradient.cwiseAbs().maxCoeff(), 1.0, 1e-12);
  EXPECT_NEAR(normal.max_diagonal() / diagonal.maxCoeff(), 1.0, 1e-12);
}

TEST_P(NormalEquationsOf, LossWeightsResidualAndJacobianByTheRootOfItsDerivative) {
  for (LossKind kind : {LossKind::kHuber, LossKind::kCauchy, LossKind::kTukey}) {
    const Loss loss{kind, 5.0};
    linearized.model.set_loss(loss);
    linearized.model.linearize(linearized.state);
    const DenseSystem weighted = make_dense_system(linearized, loss);
    const VectorXd expected = weighted.jacobian.transpose() * weighted.residual;
    for (int k = 0; k < dense.camera_columns; ++k) {
      EXPECT_NEAR(normal.camera_rhs()[k], expected[k], 1e-12 * expected.cwiseAbs().maxCoeff());
    }
    EXPECT_NEAR(normal.gradient_max_norm() / expected.cwiseAbs().maxCoeff(), 1.0, 1e-12);
  }
}

TEST_P(NormalEquationsOf, SlopesAndCurvatureAreThoseOfTheDenseModel) {
  const Step step = support::random_step(linearized, 7);
  const VectorXd flat = flatten(dense, step);
  const VectorXd of_cameras = flat.head(dense.camera_columns);
  const VectorXd of_points = flat.tail(flat.size() - of_cameras.size());
  const Slopes slopes = normal.slopes(step);
  const double tolerance = 1e-12 * gradient.norm() * flat.norm();
  EXPECT_NEAR(slopes.camera, -gradient.head(of_cameras.size()).dot(of_cameras), tolerance);
  EXPECT_NEAR(slopes.point, -gradient.tail(of_points.size()).dot(of_points), tolerance);
  EXPECT_NEAR(normal.curvature(step) / (dense.jacobian * flat).squaredNorm(), 1.0, 1e-12);
  EXPECT_NEAR(normal.model_decrease(step) / model_decrease(dense, flat), 1.0, 1e-10);
}

TEST_P(NormalEquationsOf, ThreadsDoNotChangeABitOfTheCurvature) {
  support::SceneOptions options = support::perturbed(GetParam());
  options.num_points = 1500;  // several chunks to a camera
  const support::OwnedProblem large = make_circle_scene(options);
  const LinearizedProblem one(large), two(large, false, 2);
  const Step step = support::random_step(one, 7);
  EXPECT_EQ(one.normal().curvature(step), two.normal().curvature(step));
}

INSTANTIATE_TEST_SUITE_P(Models,
                         NormalEquationsOf,
                         testing::ValuesIn(support::all_models()),
                         support::name_of_model);

TEST(Damping, IdentityAddsLambdaWhateverTheDiagonal) {
  const Damping damping{0.25, DampingMatrix::kIdentity};
  for (double diagonal : {0.0, 1e-3, 7.0, 1e40}) EXPECT_EQ(damping(diagonal), 0.25);
}

TEST(Damping, DiagonalIsKeptBetweenItsBounds) {
  const Damping damping{0.5, DampingMatrix::kDiagonal};
  EXPECT_DOUBLE_EQ(damping(8.0), 4.0);
  EXPECT_DOUBLE_EQ(damping(0.0), 0.5e-6);
  EXPECT_DOUBLE_EQ(damping(1e-7), 0.5e-6);
  EXPECT_DOUBLE_EQ(damping(1e40), 0.5e32);
}

}  // namespace
}  // namespace sfmcpp::linear

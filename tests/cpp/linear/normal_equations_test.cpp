#include "sfmcpp/linear/normal_equations.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "support/random_system.hpp"

namespace sfmcpp::linear::normal_equations_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using support::DenseSystem;
using support::RandomSystem;

class NormalEquationsOf : public testing::TestWithParam<support::SystemOptions> {
 protected:
  RandomSystem linearized{GetParam()};
  const DenseSystem& dense = linearized.dense();
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

TEST_P(NormalEquationsOf, SlopesAndCurvatureAreThoseOfTheDenseModel) {
  const Step step = support::random_step(linearized.map, 7);
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

// Several chunks to a camera.
TEST_P(NormalEquationsOf, ThreadsDoNotChangeABit) {
  support::SystemOptions options = GetParam();
  options.points = 1200;
  options.dense = false;
  const RandomSystem one(options);
  options.threads = 3;
  const RandomSystem three(options);
  const Step step = support::random_step(one.map, 7);
  EXPECT_EQ(one.normal().camera_rhs(), three.normal().camera_rhs());
  EXPECT_EQ(one.normal().camera_diagonal(), three.normal().camera_diagonal());
  EXPECT_EQ(one.normal().gradient_max_norm(), three.normal().gradient_max_norm());
  EXPECT_EQ(one.normal().max_diagonal(), three.normal().max_diagonal());
  EXPECT_EQ(one.normal().curvature(step), three.normal().curvature(step));
  EXPECT_EQ(one.normal().slopes(step).point, three.normal().slopes(step).point);
  const Damping damping{1e-3, DampingMatrix::kDiagonal};
  EXPECT_EQ(one.normal().predicted_decrease(step, damping),
            three.normal().predicted_decrease(step, damping));
}

INSTANTIATE_TEST_SUITE_P(Systems,
                         NormalEquationsOf,
                         testing::ValuesIn(support::random_systems()),
                         [](const auto& test) { return test.param.name; });

// More points than one task sums.
TEST(NormalEquations, SumsOverManyPointsAreComplete) {
  support::SystemOptions options{.cameras = 2, .points = 2 * kPointsPerSum + 100, .dense = false};
  const RandomSystem one(options);
  options.threads = 3;
  const RandomSystem three(options);
  const NormalEquations& normal = one.normal();
  const Step step = support::random_step(one.map, 7);
  const Damping damping{0.5, DampingMatrix::kDiagonal};
  double slope = 0.0, decrease = 0.0, largest = 0.0;
  for (int k = 0; k < one.map.num_columns; ++k) {
    const double d = step.camera[k];
    decrease += 0.5 * d * (normal.camera_rhs()[k] + damping(normal.camera_diagonal()[k]) * d);
    largest = std::max(largest, std::abs(normal.camera_rhs()[k]));
  }
  for (int p = 0; p < options.points; ++p) {
    const PointBlock& block = normal.point_block(p);
    for (int k = 0; k < 3; ++k) {
      const double d = step.point[3L * p + k];
      slope -= block.rhs[k] * d;
      decrease += 0.5 * d * (block.rhs[k] + damping(block.diagonal()[k]) * d);
      largest = std::max(largest, std::abs(block.rhs[k]));
    }
  }
  EXPECT_NEAR(normal.slopes(step).point / slope, 1.0, 1e-10);
  EXPECT_NEAR(normal.predicted_decrease(step, damping) / decrease, 1.0, 1e-10);
  EXPECT_EQ(normal.gradient_max_norm(), largest);
  EXPECT_EQ(three.normal().slopes(step).point, normal.slopes(step).point);
  EXPECT_EQ(three.normal().predicted_decrease(step, damping),
            normal.predicted_decrease(step, damping));
}

TEST(Damping, IdentityAddsLambdaWhateverTheDiagonal) {
  const Damping damping{0.25, DampingMatrix::kIdentity};
  for (double diagonal : {0.0, 1e-3, 7.0, 1e40}) EXPECT_EQ(damping(diagonal), 0.25);
}

TEST(Damping, DiagonalIsKeptBetweenItsBounds) {
  const Damping damping{0.5, DampingMatrix::kDiagonal};
  EXPECT_DOUBLE_EQ(damping(8.0), 4.0);
  EXPECT_DOUBLE_EQ(damping(1e-20), 0.5e-20);
  EXPECT_DOUBLE_EQ(damping(0.0), 0.5e-32);
  EXPECT_DOUBLE_EQ(damping(1e-40), 0.5e-32);
  EXPECT_DOUBLE_EQ(damping(1e40), 0.5e32);
}

}  // namespace
}  // namespace sfmcpp::linear::normal_equations_test

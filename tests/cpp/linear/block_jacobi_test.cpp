// The block diagonal of JᵀJ, and the block Gauss–Seidel sweep, against dense matrices.
#include "sfmcpp/linear/block_jacobi.hpp"

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "support/random_system.hpp"

namespace sfmcpp::linear::block_jacobi_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using support::RandomSystem;

constexpr DampingMatrix kDiagonal = DampingMatrix::kDiagonal;

class BlockJacobiOf : public testing::TestWithParam<support::SystemOptions> {
 protected:
  MatrixXd blocks(const Damping& damping) const {
    return block_diagonal(linearized.map, dense, damped_matrix(dense, damping));
  }
  Step sweep(const Damping& damping) const {
    BlockJacobi jacobi(linearized.normal());
    jacobi.factor(damping);
    Step step;
    jacobi.sweep(step);
    return step;
  }

  RandomSystem linearized{GetParam()};
  const support::DenseSystem& dense = linearized.dense();
  VectorXd b = dense.jacobian.transpose() * dense.residual;
};

TEST_P(BlockJacobiOf, SolveInvertsTheDiagonalBlocksOfTheDampedMatrix) {
  const Step g = support::random_step(linearized.map, 3);
  for (const Damping& damping : {Damping{1e-3, kDiagonal}, Damping{10.0, kDiagonal}}) {
    BlockJacobi jacobi(linearized.normal());
    jacobi.factor(damping);
    Step step;
    jacobi.solve(g, step);
    const VectorXd expected = blocks(damping).ldlt().solve(flatten(dense, g));
    EXPECT_LT((flatten(dense, step) - expected).norm(), 1e-9 * expected.norm());
  }
}

TEST_P(BlockJacobiOf, SweepIsResectionThenIntersection) {
  for (const Damping& damping :
       {Damping{1e-3, kDiagonal}, Damping{1e3, DampingMatrix::kIdentity}}) {
    const MatrixXd matrix = damped_matrix(dense, damping), diagonal = blocks(damping);
    const Eigen::Index n = dense.camera_columns, m = matrix.cols() - n;
    VectorXd expected(n + m);
    expected.head(n) = diagonal.topLeftCorner(n, n).ldlt().solve(b.head(n));
    const VectorXd left = b.tail(m) - matrix.bottomLeftCorner(m, n) * expected.head(n);
    expected.tail(m) = matrix.bottomRightCorner(m, m).ldlt().solve(left);
    const VectorXd actual = flatten(dense, sweep(damping));
    EXPECT_LT((actual.head(n) - expected.head(n)).norm(), 1e-9 * expected.head(n).norm());
    EXPECT_LT((actual.tail(m) - expected.tail(m)).norm(), 1e-9 * expected.tail(m).norm());
  }
}

TEST_P(BlockJacobiOf, SweepLowersTheQuadraticModelAndNoMoreThanItsMinimum) {
  for (double lambda : {1e-6, 1e-2, 1e2}) {
    const Damping damping{lambda, kDiagonal};
    const double decrease = model_decrease(dense, flatten(dense, sweep(damping)));
    EXPECT_GT(decrease, 0.0);
    EXPECT_LT(decrease, model_decrease(dense, solve_by_qr(dense, {1e-12, kDiagonal})));
  }
}

TEST_P(BlockJacobiOf, PointsThatMayNotMoveHaveNoStep) {
  BlockJacobi jacobi(linearized.normal());
  jacobi.factor({1e-3, kDiagonal});
  Step g = support::random_step(linearized.map, 3), solved;
  for (double& value : g.point) value = 1.0;
  jacobi.solve(g, solved);
  const Step swept = sweep({1e-3, kDiagonal});
  for (std::size_t k = 0; k < g.point.size(); ++k) {
    const bool free = linearized.map.free_point[k / 3] != 0;
    EXPECT_EQ(solved.point[k] != 0.0, free);
    EXPECT_EQ(swept.point[k] != 0.0, free);
  }
}

TEST_P(BlockJacobiOf, ThreadsDoNotChangeABit) {
  support::SystemOptions options = GetParam();
  options.threads = 2;
  const RandomSystem threaded(options);
  BlockJacobi jacobi(threaded.normal());
  jacobi.factor({1e-3, kDiagonal});
  Step step;
  jacobi.sweep(step);
  const Step one = sweep({1e-3, kDiagonal});
  EXPECT_EQ(step.camera, one.camera);
  EXPECT_EQ(step.point, one.point);
}

INSTANTIATE_TEST_SUITE_P(Scenes,
                         BlockJacobiOf,
                         testing::ValuesIn(support::random_systems()),
                         [](const auto& test) { return test.param.name; });

}  // namespace
}  // namespace sfmcpp::linear::block_jacobi_test

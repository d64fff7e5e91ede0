// The diagonal blocks of U and of the Schur complement against dense matrices.
#include "sfmcpp/linear/block_diagonal.hpp"

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "sfmcpp/linear/point_elimination.hpp"
#include "support/random_system.hpp"

namespace sfmcpp::linear::camera_block_diagonal_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using support::RandomSystem;

class CameraBlockDiagonalOf : public testing::TestWithParam<support::SystemOptions> {
 protected:
  // Σ Jᵀ (I − A V*⁻¹ Aᵀ) J of each observation alone, and Σ Jᵀ (r − A V*⁻¹ b_p).
  void add_reduced_observation(int k, const MatrixXd& matrix, MatrixXd& s, VectorXd& rhs) const {
    const MatrixXd j = dense.jacobian.block(2 * k, 0, 2, dense.camera_columns);
    MatrixXd weight = MatrixXd::Identity(2, 2);
    VectorXd r = dense.residual.segment(2 * k, 2);
    const int point = dense.point_column[linearized.graph.point[k]];
    if (point >= 0) {
      const MatrixXd a = dense.jacobian.block(2 * k, point, 2, 3);
      const Eigen::LDLT<MatrixXd> v(matrix.block(point, point, 3, 3));
      weight -= a * v.solve(a.transpose());
      r -= a * v.solve(b.segment(point, 3));
    }
    s += j.transpose() * weight * j;
    rhs += j.transpose() * r;
  }

  static void expect_close(const std::vector<double>& actual, const VectorXd& expected) {
    const Eigen::Map<const VectorXd> values(actual.data(), expected.size());
    EXPECT_LT((values - expected).norm(), 1e-9 * expected.norm());
  }
  std::vector<double> some_rhs() const { return support::random_step(linearized.map, 5).camera; }
  static VectorXd vector(const std::vector<double>& values) {
    return Eigen::Map<const VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
  }

  RandomSystem linearized{GetParam()};
  const support::DenseSystem& dense = linearized.dense();
  VectorXd b = dense.jacobian.transpose() * dense.residual;
  Damping damping{1e-2, DampingMatrix::kDiagonal};
  CameraBlockDiagonal blocks{linearized.normal()};
};

TEST_P(CameraBlockDiagonalOf, HoldsTheBlocksOfUWhereThePointsAreHeld) {
  const std::vector<PointFactor> none(linearized.graph.num_points);
  std::vector<double> rhs, solution;
  blocks.assemble(none.data(), rhs);
  blocks.factor(linearized.normal().camera_damping(damping));
  blocks.solve(some_rhs(), solution);
  const Eigen::Index n = dense.camera_columns;
  const MatrixXd u =
      block_diagonal(linearized.map, dense, damped_matrix(dense, damping).topLeftCorner(n, n));
  expect_close(solution, u.ldlt().solve(vector(some_rhs())));
  expect_close(rhs, b.head(n));
}

TEST_P(CameraBlockDiagonalOf, HoldsTheDiagonalBlocksOfTheSchurComplement) {
  PointElimination elimination(linearized.normal());
  elimination.factor(damping);
  std::vector<double> rhs, solution;
  blocks.assemble(elimination.factors(), rhs);
  blocks.factor(linearized.normal().camera_damping(damping));
  blocks.solve(some_rhs(), solution);

  const Eigen::Index n = dense.camera_columns;
  const MatrixXd matrix = damped_matrix(dense, damping);
  MatrixXd s = damping_diagonal(dense, damping).head(n).asDiagonal();
  VectorXd expected_rhs = VectorXd::Zero(n);
  for (int k = 0; k < linearized.graph.num_observations(); ++k) {
    add_reduced_observation(k, matrix, s, expected_rhs);
  }
  expect_close(solution, block_diagonal(linearized.map, dense, s).ldlt().solve(vector(some_rhs())));
  expect_close(rhs, expected_rhs);
}

TEST_P(CameraBlockDiagonalOf, IndefiniteBlocksAreReplacedByTheirDiagonal) {
  const std::vector<PointFactor> none(linearized.graph.num_points);
  const std::vector<double>& u = linearized.normal().camera_diagonal();
  std::vector<double> rhs, solution, minus_three(u.size());
  for (std::size_t k = 0; k < u.size(); ++k) minus_three[k] = -3.0 * u[k];
  blocks.assemble(none.data(), rhs);
  blocks.factor(minus_three);
  blocks.solve(some_rhs(), solution);
  VectorXd expected = vector(some_rhs());
  for (std::size_t k = 0; k < u.size(); ++k) expected[static_cast<int>(k)] /= 2.0 * u[k];
  expect_close(solution, expected);
}

INSTANTIATE_TEST_SUITE_P(Scenes,
                         CameraBlockDiagonalOf,
                         testing::ValuesIn(support::random_systems()),
                         [](const auto& test) { return test.param.name; });

}  // namespace
}  // namespace sfmcpp::linear::camera_block_diagonal_test

namespace sfmcpp::linear::block_jacobi_test {

// The block diagonal of JᵀJ, and the block Gauss–Seidel sweep, against dense matrices.

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

// The diagonal blocks of U and of the Schur complement against dense matrices.
#include "sfmcpp/linear/camera_block_diagonal.hpp"

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

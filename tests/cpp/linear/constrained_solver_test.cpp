// Linear algebra with residuals between cameras, near ones and ones that share no point, against
// dense matrices of the whole problem.
#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "sfmcpp/linear/block_diagonal.hpp"
#include "sfmcpp/linear/linear_solver.hpp"
#include "support/random_system.hpp"

namespace sfmcpp::linear::constrained_solver_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using support::DenseSystem;
using support::RandomSystem;

constexpr LinearSolverKind kSolvers[] = {
    LinearSolverKind::kDense, LinearSolverKind::kSparse, LinearSolverKind::kIterative};

// Eight cameras of which only neighbours share points, and residuals of one camera and of two, near
// ones and ones that share no point.
std::vector<support::SystemOptions> systems() {
  std::vector<support::SystemOptions> result = support::random_systems();
  for (support::SystemOptions& options : result) {
    options.cameras = 8;
    options.points = 80;
    options.window = 2;
    options.pairs = {{1, 1}, {4, 4}, {0, 1}, {1, 5}, {7, 2}, {5, 2}, {0, 4}, {2, 3}, {6, 3}};
  }
  return result;
}

class ConstrainedSolver : public testing::TestWithParam<support::SystemOptions> {
 protected:
  VectorXd solution(LinearSolverKind kind, const Damping& damping) {
    Step step;
    EXPECT_TRUE(linearized.solve({kind, 1e-12, 5000}, damping, step).success);
    return flatten(dense, step);
  }
  static VectorXd vector(const std::vector<double>& values) {
    return Eigen::Map<const VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
  }
  static void expect_close(const VectorXd& actual, const VectorXd& expected, double tolerance) {
    ASSERT_EQ(actual.size(), expected.size());
    EXPECT_LT((actual - expected).norm(), tolerance * expected.norm());
  }

  RandomSystem linearized{GetParam()};
  const DenseSystem& dense = linearized.dense();
  VectorXd b = dense.jacobian.transpose() * dense.residual;
  const NormalEquations& normal = linearized.normal();
};

TEST_P(ConstrainedSolver, GradientAndDiagonalCountTheConstraints) {
  const Eigen::Index n = dense.camera_columns;
  expect_close(vector(normal.camera_rhs()), b.head(n), 1e-12);
  const VectorXd diagonal = dense.jacobian.colwise().squaredNorm();
  expect_close(vector(normal.camera_diagonal()), diagonal.head(n), 1e-12);
  EXPECT_NEAR(normal.gradient_max_norm(), b.cwiseAbs().maxCoeff(), 1e-9 * b.norm());
  EXPECT_NEAR(normal.max_diagonal(), diagonal.maxCoeff(), 1e-9 * diagonal.maxCoeff());
}

TEST_P(ConstrainedSolver, SlopesAndCurvatureCountTheConstraints) {
  const Step step = support::random_step(linearized.map, 9);
  const VectorXd delta = flatten(dense, step);
  const Slopes slopes = normal.slopes(step);
  EXPECT_NEAR((slopes.camera + slopes.point) / -b.dot(delta), 1.0, 1e-10);
  EXPECT_NEAR(normal.curvature(step) / (dense.jacobian * delta).squaredNorm(), 1.0, 1e-10);
  EXPECT_NEAR(normal.model_decrease(step) / model_decrease(dense, delta), 1.0, 1e-10);
}

TEST_P(ConstrainedSolver, EverySolverAgreesWithQr) {
  for (const Damping& damping : {Damping{1e-3, DampingMatrix::kDiagonal},
                                 Damping{10.0, DampingMatrix::kDiagonal},
                                 Damping{1e3, DampingMatrix::kIdentity}}) {
    const VectorXd reference = solve_by_qr(dense, damping);
    for (LinearSolverKind kind : kSolvers) {
      const double tolerance = kind == LinearSolverKind::kIterative ? 1e-6 : 1e-9;
      SCOPED_TRACE(std::string(enum_name(kind)) + ", " + std::to_string(damping.lambda));
      expect_close(solution(kind, damping), reference, tolerance);
    }
  }
}

TEST_P(ConstrainedSolver, PredictedDecreaseIsThatOfTheDenseModel) {
  for (LinearSolverKind kind : kSolvers) {
    const Damping damping{1e-2, DampingMatrix::kDiagonal};
    Step step;
    ASSERT_TRUE(linearized.solve({kind, 1e-2, 5000}, damping, step).success);
    const double expected = model_decrease(dense, flatten(dense, step));
    EXPECT_GT(expected, 0.0);
    EXPECT_NEAR(normal.predicted_decrease(step, damping) / expected, 1.0, 1e-7);
  }
}

TEST_P(ConstrainedSolver, BlockJacobiHoldsTheDiagonalBlocksOfAllResiduals) {
  const Step g = support::random_step(linearized.map, 3);
  const Damping damping{1e-3, DampingMatrix::kDiagonal};
  BlockJacobi jacobi(normal);
  jacobi.factor(damping);
  Step step;
  jacobi.solve(g, step);
  const MatrixXd blocks = block_diagonal(linearized.map, dense, damped_matrix(dense, damping));
  expect_close(flatten(dense, step), blocks.ldlt().solve(flatten(dense, g)), 1e-9);
}

TEST_P(ConstrainedSolver, SweepLowersTheQuadraticModel) {
  for (double lambda : {1e-6, 1e-2, 1e2}) {
    BlockJacobi jacobi(normal);
    jacobi.factor({lambda, DampingMatrix::kDiagonal});
    Step step;
    jacobi.sweep(step);
    EXPECT_GT(model_decrease(dense, flatten(dense, step)), 0.0);
  }
}

TEST_P(ConstrainedSolver, ThreadsDoNotChangeABit) {
  support::SystemOptions options = GetParam();
  options.threads = 3;
  const RandomSystem threaded(options);
  for (LinearSolverKind kind : kSolvers) {
    const Damping damping{1e-3, DampingMatrix::kDiagonal};
    Step one, three;
    ASSERT_TRUE(linearized.solve({kind, 1e-3, 5000}, damping, one).success);
    ASSERT_TRUE(threaded.solve({kind, 1e-3, 5000}, damping, three).success);
    EXPECT_EQ(one.camera, three.camera) << enum_name(kind);
    EXPECT_EQ(one.point, three.point) << enum_name(kind);
  }
}

INSTANTIATE_TEST_SUITE_P(Systems,
                         ConstrainedSolver,
                         testing::ValuesIn(systems()),
                         [](const auto& test) { return test.param.name; });

}  // namespace
}  // namespace sfmcpp::linear::constrained_solver_test

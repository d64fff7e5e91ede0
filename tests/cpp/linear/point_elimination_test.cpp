// Another right-hand side with the factors of the last solve, against the dense damped matrix.
#include "sfmcpp/linear/point_elimination.hpp"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "support/random_system.hpp"

namespace sfmcpp::linear::other_residuals_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using support::RandomSystem;

class SolveAgain : public testing::TestWithParam<support::SystemOptions> {
 protected:
  // The rows of observations come first, in stored order; residuals of cameras alone are zero.
  VectorXd other_residuals() const {
    VectorXd h = VectorXd::Zero(dense.residual.size());
    const long observed = 2L * system.graph.num_observations();
    for (long k = 0; k < observed; ++k) h[k] = std::sin(0.7 * static_cast<double>(k) + 1.0);
    return h;
  }
  Step solved_again(LinearSolverKind kind, Unknowns unknowns) const {
    const auto solver = make_linear_solver(system.normal(), {kind, 1e-10, 5000});
    Step step;
    EXPECT_TRUE(solver->solve(damping, step, [] { return false; }).success);
    const VectorXd h = other_residuals();
    EXPECT_TRUE(solver->can_solve_again(unknowns));
    EXPECT_TRUE(solver->solve_again(unknowns, std::span(h.data(), h.size()), step));
    return step;
  }

  RandomSystem system{GetParam()};
  const support::DenseSystem& dense = system.dense();
  Damping damping{1e-2, DampingMatrix::kDiagonal};
  MatrixXd matrix = damped_matrix(dense, damping);
  VectorXd rhs = dense.jacobian.transpose() * other_residuals();
};

TEST_P(SolveAgain, AllUnknownsAreThoseOfTheDenseSystem) {
  const VectorXd reference = matrix.ldlt().solve(rhs);
  for (LinearSolverKind kind : {LinearSolverKind::kDense, LinearSolverKind::kSparse}) {
    const VectorXd found = flatten(dense, solved_again(kind, Unknowns::kAll));
    EXPECT_LT((found - reference).norm(), 1e-8 * reference.norm()) << enum_name(kind);
  }
}

TEST_P(SolveAgain, PointsAreThoseOfTheDenseSystemWithTheCamerasHeld) {
  const long points = matrix.rows() - dense.camera_columns;
  VectorXd reference = VectorXd::Zero(matrix.rows());
  reference.tail(points) = matrix.bottomRightCorner(points, points).ldlt().solve(rhs.tail(points));
  for (LinearSolverKind kind :
       {LinearSolverKind::kDense, LinearSolverKind::kSparse, LinearSolverKind::kIterative}) {
    const VectorXd found = flatten(dense, solved_again(kind, Unknowns::kPoints));
    EXPECT_LT((found - reference).norm(), 1e-9 * reference.norm()) << enum_name(kind);
  }
}

INSTANTIATE_TEST_SUITE_P(Systems,
                         SolveAgain,
                         testing::ValuesIn(support::random_systems()),
                         [](const auto& test) { return test.param.name; });

}  // namespace
}  // namespace sfmcpp::linear::other_residuals_test

// Problems at the edge of what can be solved: rank-deficient points, nothing to solve for, matrices
// that are not positive definite, and a caller that wants to stop.
#include <algorithm>
#include <cmath>

#include <Eigen/QR>
#include <gtest/gtest.h>

#include "support/random_system.hpp"

namespace sfmcpp::linear::linear_solver_limits_test {
namespace {

using Eigen::VectorXd;
using support::RandomSystem;
using support::SystemOptions;

class LinearSolverLimits : public testing::TestWithParam<LinearSolverKind> {
 protected:
  LinearSolverOptions options{GetParam(), 1e-10, 5000};

  void expect_agreement(const SystemOptions& system, double tolerance = 1e-7) const;

  static SystemOptions nine_columns() { return {.points = 25, .camera_size = 9}; }
  // The last of the points is seen by camera 2 alone.
  static SystemOptions one_seen_once() {
    SystemOptions options = nine_columns();
    options.points = 26;
    options.sees = [](int camera, int point) { return point < 25 || camera == 2; };
    return options;
  }
};

bool all_finite(const Step& step) {
  const auto finite = [](double x) { return std::isfinite(x); };
  return std::all_of(step.camera.begin(), step.camera.end(), finite) &&
         std::all_of(step.point.begin(), step.point.end(), finite);
}

void LinearSolverLimits::expect_agreement(const SystemOptions& system, double tolerance) const {
  const RandomSystem linearized(system);
  const Damping damping{1e-3, DampingMatrix::kDiagonal};
  const VectorXd reference = solve_by_qr(linearized.dense(), damping);
  Step step;
  ASSERT_TRUE(linearized.solve(options, damping, step).success);
  EXPECT_LT((flatten(linearized.dense(), step) - reference).norm(), tolerance * reference.norm());
}

TEST_P(LinearSolverLimits, APointSeenOnceIsHeldByDampingAndAgreesWithQr) {
  expect_agreement(one_seen_once());
}

// V has rank two: without damping the step along the ray is anything; it must stay finite, and
// small enough for the model to hold.
TEST_P(LinearSolverLimits, APointSeenOnceHasAFiniteUndampedStep) {
  const RandomSystem linearized(one_seen_once());
  Step step;
  ASSERT_TRUE(linearized.solve(options, {0.0, DampingMatrix::kIdentity}, step).success);
  ASSERT_TRUE(all_finite(step));
  const VectorXd flat = flatten(linearized.dense(), step);
  EXPECT_LT(flat.tail<3>().norm(), 300.0);  // residuals and derivatives here are of order one
  // The step of all others is the one without that observation: its residual, of rank two, can be
  // met by the point.
  const support::DenseSystem& all = linearized.dense();
  const Eigen::Index n = all.jacobian.cols() - 3;
  std::vector<Eigen::Index> rows;
  for (Eigen::Index row = 0; row < all.jacobian.rows(); ++row) {
    if (all.jacobian.row(row).tail<3>().isZero(0.0)) rows.push_back(row);
  }
  ASSERT_EQ(static_cast<Eigen::Index>(rows.size()), all.jacobian.rows() - 2);
  const Eigen::MatrixXd jacobian = all.jacobian(rows, Eigen::seqN(0, n));
  const VectorXd expected = jacobian.householderQr().solve(VectorXd(all.residual(rows)));
  EXPECT_LT((flat.head(n) - expected).norm(), 1e-6 * expected.norm());
}

TEST_P(LinearSolverLimits, WithEveryCameraFixedSolvesForThePointsAlone) {
  SystemOptions intersection{.points = 25, .fixed_cameras = {0, 1, 2, 3, 4, 5}};
  ASSERT_EQ(make_map(intersection).num_columns, 0);
  expect_agreement(intersection, 1e-10);
}

TEST_P(LinearSolverLimits, WithEveryPointFixedSolvesForTheCamerasAlone) {
  SystemOptions resection = nine_columns();
  for (int p = 0; p < resection.points; ++p) resection.fixed_points.push_back(p);
  expect_agreement(resection, 1e-8);
}

TEST_P(LinearSolverLimits, CamerasThatShareNoPointAreSolvedEachOnItsOwn) {
  SystemOptions apart{.cameras = 4, .points = 40};
  apart.sees = [](int camera, int point) { return camera % 2 == point % 2; };
  expect_agreement(apart);
}

TEST_P(LinearSolverLimits, SolvesAgainForAnotherDampingAsIfItWereTheFirstTime) {
  const RandomSystem linearized(nine_columns());
  const auto solver = make_linear_solver(linearized.normal(), options);
  const auto go_on = [] { return false; };
  Step first, second, again;
  ASSERT_TRUE(solver->solve({1e-3, DampingMatrix::kDiagonal}, first, go_on).success);
  ASSERT_TRUE(solver->solve({10.0, DampingMatrix::kDiagonal}, second, go_on).success);
  ASSERT_TRUE(solver->solve({1e-3, DampingMatrix::kDiagonal}, again, go_on).success);
  EXPECT_NE(first.camera, second.camera);
  EXPECT_EQ(first.camera, again.camera);
  EXPECT_EQ(first.point, again.point);
}

INSTANTIATE_TEST_SUITE_P(Kinds,
                         LinearSolverLimits,
                         testing::Values(LinearSolverKind::kDense,
                                         LinearSolverKind::kSparse,
                                         LinearSolverKind::kIterative),
                         [](const auto& test) { return std::string(enum_name(test.param)); });

TEST(DirectSolver, ReportsASystemThatIsNotPositiveDefinite) {
  const RandomSystem linearized({.points = 12, .camera_size = 9, .blind_columns = {7, 8}});
  for (LinearSolverKind kind : {LinearSolverKind::kDense, LinearSolverKind::kSparse}) {
    Step step;
    EXPECT_FALSE(
        linearized.solve({kind, 1e-2, 500}, {0.0, DampingMatrix::kIdentity}, step).success);
    EXPECT_TRUE(
        linearized.solve({kind, 1e-2, 500}, {1e-3, DampingMatrix::kDiagonal}, step).success);
    EXPECT_TRUE(all_finite(step));
  }
}

TEST(IterativeSolver, StopsWhenAskedAndKeepsADescentStep) {
  const RandomSystem linearized({.cameras = 30, .points = 150, .camera_size = 9, .window = 4});
  const auto solver =
      make_linear_solver(linearized.normal(), {LinearSolverKind::kIterative, 1e-12, 100000});
  const Damping damping{1e-8, DampingMatrix::kDiagonal};
  Step whole, stopped;
  const int all = solver->solve(damping, whole, [] { return false; }).iterations;
  const LinearSolveResult early = solver->solve(damping, stopped, [] { return true; });
  EXPECT_TRUE(early.success);
  EXPECT_LT(early.iterations, all / 2);
  const double predicted = linearized.normal().predicted_decrease(stopped, damping);
  EXPECT_GT(predicted, 0.0);
  EXPECT_LT(predicted, linearized.normal().predicted_decrease(whole, damping));
}

TEST(IterativeSolver, KeepsToItsLimitOfIterations) {
  const RandomSystem linearized({.points = 40, .camera_size = 9});
  Step step;
  const LinearSolverOptions options{LinearSolverKind::kIterative, 1e-15, 7};
  const auto result = linearized.solve(options, {1e-6, DampingMatrix::kDiagonal}, step);
  EXPECT_EQ(result.iterations, 7);
}

}  // namespace
}  // namespace sfmcpp::linear::linear_solver_limits_test

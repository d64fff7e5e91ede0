// Every linear solver against QR of the full damped Jacobian.
#include "sfmcpp/linear/linear_solver.hpp"

#include <gtest/gtest.h>

#include "support/random_system.hpp"

namespace sfmcpp::linear::linear_solver_test {
namespace {

using Eigen::VectorXd;
using support::DenseSystem;
using support::RandomSystem;

class LinearSolverAgainstQr : public testing::TestWithParam<support::SystemOptions> {
 protected:
  VectorXd solution(LinearSolverKind kind, const Damping& damping, double pcg_tolerance = 1e-10) {
    Step step;
    const LinearSolverOptions options{kind, pcg_tolerance, 5000};
    EXPECT_TRUE(linearized.solve(options, damping, step).success);
    return flatten(dense, step);
  }
  double model_error(const VectorXd& error, const Damping& damping) const {
    const VectorXd damped = damping_diagonal(dense, damping).cwiseSqrt().cwiseProduct(error);
    return std::hypot((dense.jacobian * error).norm(), damped.norm());
  }

  RandomSystem linearized{GetParam()};
  const DenseSystem& dense = linearized.dense();
};

TEST_P(LinearSolverAgainstQr, DirectSolversAgreeForEveryDamping) {
  for (double lambda : {1e-8, 1e-3, 10.0}) {
    const Damping damping{lambda, DampingMatrix::kDiagonal};
    const VectorXd reference = solve_by_qr(dense, damping);
    for (LinearSolverKind kind : {LinearSolverKind::kDense, LinearSolverKind::kSparse}) {
      const VectorXd error = solution(kind, damping) - reference;
      EXPECT_LT(model_error(error, damping), 1e-9 * model_error(reference, damping));
      EXPECT_LT(error.norm(), 1e-9 * reference.norm()) << enum_name(kind) << ", lambda " << lambda;
    }
  }
}

TEST_P(LinearSolverAgainstQr, DirectSolversAgreeForIdentityDamping) {
  const Damping damping{1e3, DampingMatrix::kIdentity};
  const VectorXd reference = solve_by_qr(dense, damping);
  for (LinearSolverKind kind : {LinearSolverKind::kDense, LinearSolverKind::kSparse}) {
    EXPECT_LT((solution(kind, damping) - reference).norm(), 1e-9 * reference.norm());
  }
}

TEST_P(LinearSolverAgainstQr, UndampedStepsAgree) {
  const Damping none{0.0, DampingMatrix::kIdentity};
  const VectorXd reference = solve_by_qr(dense, none);
  for (LinearSolverKind kind : {LinearSolverKind::kDense, LinearSolverKind::kSparse}) {
    EXPECT_LT((solution(kind, none) - reference).norm(), 1e-9 * reference.norm())
        << enum_name(kind);
  }
}

TEST_P(LinearSolverAgainstQr, IterativeSolverGoesAsFarAsItsTolerance) {
  for (double lambda : {1e-3, 10.0}) {
    const Damping damping{lambda, DampingMatrix::kDiagonal};
    const VectorXd reference = solve_by_qr(dense, damping);
    const VectorXd fine = solution(LinearSolverKind::kIterative, damping, 1e-10);
    EXPECT_LT((fine - reference).norm(), 1e-6 * reference.norm()) << "lambda " << lambda;
    const VectorXd coarse = solution(LinearSolverKind::kIterative, damping, 1e-2);
    EXPECT_LT(model_decrease(dense, fine) - model_decrease(dense, coarse),
              0.01 * model_decrease(dense, fine));
  }
}

// ½ δᵀ (b + λ D δ) against ½‖r‖² − ½‖r − J δ‖²: it holds for conjugate gradients stopped anywhere.
TEST_P(LinearSolverAgainstQr, PredictedDecreaseIsThatOfTheDenseModel) {
  for (LinearSolverKind kind :
       {LinearSolverKind::kDense, LinearSolverKind::kSparse, LinearSolverKind::kIterative}) {
    for (DampingMatrix matrix : {DampingMatrix::kDiagonal, DampingMatrix::kIdentity}) {
      const Damping damping{1e-2, matrix};
      Step step;
      ASSERT_TRUE(linearized.solve({kind, 1e-2, 5000}, damping, step).success);
      const double expected = model_decrease(dense, flatten(dense, step));
      const double predicted = linearized.normal().predicted_decrease(step, damping);
      EXPECT_GT(expected, 0.0);
      EXPECT_NEAR(predicted, expected, 1e-7 * expected)
          << enum_name(kind) << " " << static_cast<int>(matrix);
    }
  }
}

TEST_P(LinearSolverAgainstQr, PointsThatMayNotMoveHaveNoStep) {
  for (LinearSolverKind kind :
       {LinearSolverKind::kDense, LinearSolverKind::kSparse, LinearSolverKind::kIterative}) {
    Step step;
    ASSERT_TRUE(
        linearized.solve({kind, 1e-8, 5000}, {1e-3, DampingMatrix::kDiagonal}, step).success);
    for (std::size_t p = 0; p < dense.point_column.size(); ++p) {
      if (dense.point_column[p] >= 0) continue;
      for (int k = 0; k < 3; ++k) EXPECT_EQ(step.point[3 * p + k], 0.0);
    }
  }
}

TEST_P(LinearSolverAgainstQr, ATighterToleranceTakesMoreIterationsAndComesCloser) {
  const Damping damping{1e-3, DampingMatrix::kDiagonal};
  const VectorXd reference = solve_by_qr(dense, damping);
  int previous_iterations = 0;
  double previous_error = 1e300, first_error = 0.0;
  for (double tolerance : {1e-1, 1e-3, 1e-6, 1e-9}) {
    Step step;
    const LinearSolverOptions options{LinearSolverKind::kIterative, tolerance, 5000};
    const LinearSolveResult result = linearized.solve(options, damping, step);
    const double error = model_error(flatten(dense, step) - reference, damping);
    // The last digits may all come with one iteration, when those before have met every unknown.
    EXPECT_GE(result.iterations, previous_iterations);
    EXPECT_LE(error, previous_error);
    if (previous_iterations == 0) first_error = error;
    previous_iterations = result.iterations;
    previous_error = error;
  }
  EXPECT_LT(previous_error, 1e-3 * first_error);
}

// What a solver keeps from one solve to the next is that of the same system.
TEST_P(LinearSolverAgainstQr, SolvingAgainGivesTheBitsOfANewSolver) {
  for (LinearSolverKind kind :
       {LinearSolverKind::kDense, LinearSolverKind::kSparse, LinearSolverKind::kIterative}) {
    const LinearSolverOptions options{kind, 1e-3, 5000};
    const auto solver = make_linear_solver(linearized.normal(), options);
    const auto expect_that_of_a_new_one = [&](const Damping& damping) {
      Step step, fresh;
      ASSERT_TRUE(solver->solve(damping, step, {}).success);
      ASSERT_TRUE(linearized.solve(options, damping, fresh).success);
      EXPECT_EQ(step.camera, fresh.camera) << enum_name(kind);
      EXPECT_EQ(step.point, fresh.point) << enum_name(kind);
      linearized.move(step);
    };
    const Damping damping{1e-3, DampingMatrix::kDiagonal};
    Step free, held;
    ASSERT_TRUE(solver->solve(damping, free, {}).success);
    linearized.hold_intrinsics(true);
    ASSERT_TRUE(solver->solve(damping, held, {}).success);
    EXPECT_NE(held.camera, free.camera);
    expect_that_of_a_new_one(damping);
    linearized.hold_intrinsics(false);
    expect_that_of_a_new_one(damping);
    expect_that_of_a_new_one({1e-2, DampingMatrix::kDiagonal});
    expect_that_of_a_new_one({1e-2, DampingMatrix::kIdentity});
  }
}

// As if the Jacobian had no columns of intrinsics; from the factors of all unknowns and anew.
TEST_P(LinearSolverAgainstQr, TheDenseSolverLeavesHeldIntrinsicsOut) {
  const Damping damping{1e-3, DampingMatrix::kDiagonal};
  DenseSystem poses_alone = dense;
  for (int k = 0; k < dense.camera_columns; ++k) {
    if (linearized.map.is_intrinsic[k] != 0) poses_alone.jacobian.col(k).setZero();
  }
  const VectorXd reference = solve_by_qr(poses_alone, damping);
  const auto solver = make_linear_solver(linearized.normal(), {LinearSolverKind::kDense});
  Step free, after_free, anew;
  ASSERT_TRUE(solver->solve(damping, free, {}).success);
  linearized.hold_intrinsics(true);
  ASSERT_TRUE(solver->solve(damping, after_free, {}).success);
  ASSERT_TRUE(linearized.solve({LinearSolverKind::kDense}, damping, anew).success);
  EXPECT_EQ(after_free.camera, anew.camera);
  EXPECT_EQ(after_free.point, anew.point);
  const VectorXd error = flatten(dense, anew) - reference;
  EXPECT_LT(model_error(error, damping), 1e-9 * model_error(reference, damping));
  for (int k = 0; k < dense.camera_columns; ++k) {
    EXPECT_TRUE(linearized.map.is_intrinsic[k] == 0 || anew.camera[k] == 0.0) << k;
  }
}

INSTANTIATE_TEST_SUITE_P(Systems,
                         LinearSolverAgainstQr,
                         testing::ValuesIn(support::random_systems()),
                         [](const auto& test) { return test.param.name; });

// More rows than are formed in one batch where columns are shared.
TEST(ExplicitSolver, SharedColumnsGetEveryRowWhateverTheNumberOfThreads) {
  support::SystemOptions options{
      .cameras = 90, .points = 180, .camera_size = 9, .shared = 3, .groups = 2, .window = 3};
  const RandomSystem one(options);
  options.threads = 3;
  const RandomSystem three(options);
  const Damping damping{1e-3, DampingMatrix::kDiagonal};
  const VectorXd reference = solve_by_qr(one.dense(), damping);
  for (LinearSolverKind kind : {LinearSolverKind::kDense, LinearSolverKind::kSparse}) {
    Step step, threaded;
    ASSERT_TRUE(one.solve({kind}, damping, step).success);
    ASSERT_TRUE(three.solve({kind}, damping, threaded).success);
    EXPECT_LT((flatten(one.dense(), step) - reference).norm(), 1e-9 * reference.norm());
    EXPECT_EQ(step.camera, threaded.camera);
    EXPECT_EQ(step.point, threaded.point);
  }
}

}  // namespace
}  // namespace sfmcpp::linear::linear_solver_test

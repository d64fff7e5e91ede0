// Every linear solver against QR of the full damped Jacobian.
#include "sfmcpp/linear/linear_solver.hpp"

#include <ostream>

#include <gtest/gtest.h>

#include "sfmcpp/optim/options.hpp"
#include "support/dense_reference.hpp"

namespace sfmcpp::linear {
namespace {

using Eigen::VectorXd;
using support::DenseSystem;
using support::LinearizedProblem;
using support::OwnedProblem;

struct Case {
  const char* name;
  CameraModelId model;
  int groups = 0;
  bool some_fixed = false;
  bool fix_gauge = false;
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

OwnedProblem make_scene(const Case& c) {
  support::SceneOptions options = support::perturbed(c.model);
  options.num_groups = c.groups;
  options.num_points = 30;
  options.window = 4;
  options.varied_sigma = true;
  if (c.model == CameraModelId::kPerspective)
    options.free_intrinsics = std::vector<int>{0, 2, 3, 5, 6};
  OwnedProblem scene = make_circle_scene(options);
  if (c.some_fixed) {
    scene.fixed_cameras[2] = scene.fixed_cameras[3] = 1;
    scene.fixed_points[0] = scene.fixed_points[17] = 1;
    if (has_free_intrinsics(c.model)) scene.fixed_intrinsics[0] = 1;
  }
  return scene;
}

class LinearSolverAgainstQr : public testing::TestWithParam<Case> {
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

  LinearizedProblem linearized{make_scene(GetParam()), GetParam().fix_gauge};
  DenseSystem dense = make_dense_system(linearized);
};

// Along the directions of a free gauge only λD holds the step: there rounding is amplified by
// 1/λ, and what is compared is the effect of the step, ‖[J; √(λD)] (δ − δ_QR)‖.
TEST_P(LinearSolverAgainstQr, DirectSolversAgreeForEveryDamping) {
  for (double lambda : {1e-8, 1e-3, 10.0}) {
    const Damping damping{lambda, DampingMatrix::kDiagonal};
    const VectorXd reference = solve_by_qr(dense, damping);
    for (LinearSolverKind kind : {LinearSolverKind::kDense, LinearSolverKind::kSparse}) {
      const VectorXd error = solution(kind, damping) - reference;
      EXPECT_LT(model_error(error, damping), 1e-9 * model_error(reference, damping));
      if (lambda > 1e-4 || GetParam().fix_gauge) {
        EXPECT_LT(error.norm(), 1e-9 * reference.norm())
            << enum_name(kind) << ", lambda " << lambda;
      }
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

// Two fixed cameras hold the gauge as well, but not the scales of homogeneous coordinates.
class UndampedSolverAgainstQr : public LinearSolverAgainstQr {};

TEST_P(UndampedSolverAgainstQr, GaussNewtonStepsAgreeWhereTheGaugeIsHeld) {
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
          << enum_name(kind) << " " << enum_name(matrix);
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

std::vector<Case> all_cases() {
  using Id = CameraModelId;
  return {{"CalibratedFree", Id::kCalibrated},
          {"CalibratedSomeFixed", Id::kCalibrated, 0, true},
          {"CalibratedGaugeFixed", Id::kCalibrated, 0, false, true},
          {"PerspectivePrivate", Id::kPerspective},
          {"PerspectiveShared", Id::kPerspective, 2},
          {"PerspectiveOneForAll", Id::kPerspective, 1},
          {"PerspectiveSharedSomeFixed", Id::kPerspective, 2, true},
          {"PerspectiveSharedGaugeFixed", Id::kPerspective, 2, false, true},
          {"BalPrivate", Id::kBal},
          {"BalShared", Id::kBal, 2},
          {"BalSomeFixed", Id::kBal, 0, true},
          {"BalGaugeFixed", Id::kBal, 0, false, true},
          {"BalSharedGaugeFixed", Id::kBal, 3, false, true},
          {"Projective", Id::kProjective},
          {"ProjectiveSomeFixed", Id::kProjective, 0, true}};
}

INSTANTIATE_TEST_SUITE_P(Problems,
                         LinearSolverAgainstQr,
                         testing::ValuesIn(all_cases()),
                         [](const auto& test) { return std::string(test.param.name); });

std::vector<Case> cases_with_gauge_held() {
  std::vector<Case> held = all_cases();
  std::erase_if(
      held, [](const Case& c) { return !is_metric(c.model) || (!c.fix_gauge && !c.some_fixed); });
  return held;
}

INSTANTIATE_TEST_SUITE_P(Problems,
                         UndampedSolverAgainstQr,
                         testing::ValuesIn(cases_with_gauge_held()),
                         [](const auto& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace sfmcpp::linear

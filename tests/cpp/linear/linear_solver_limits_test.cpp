// Problems at the edge of what can be solved: rank-deficient points, nothing to solve for, matrices
// that are not positive definite, and a caller that wants to stop.
#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "support/dense_reference.hpp"

namespace sfmcpp::linear {
namespace {

using Eigen::VectorXd;
using support::LinearizedProblem;
using support::OwnedProblem;

class LinearSolverLimits : public testing::TestWithParam<LinearSolverKind> {
 protected:
  LinearSolverOptions options{GetParam(), 1e-10, 5000};

  static OwnedProblem scene(CameraModelId model = CameraModelId::kBal) {
    support::SceneOptions scene_options = support::perturbed(model);
    scene_options.num_points = 25;
    return make_circle_scene(scene_options);
  }
};

bool all_finite(const Step& step) {
  const auto finite = [](double x) { return std::isfinite(x); };
  return std::all_of(step.camera.begin(), step.camera.end(), finite) &&
         std::all_of(step.point.begin(), step.point.end(), finite);
}

TEST_P(LinearSolverLimits, APointSeenOnceIsHeldByDampingAndAgreesWithQr) {
  OwnedProblem once = scene();
  once.points.insert(once.points.end(), {0.5, -0.5, 0.25});
  once.fixed_points.push_back(0);
  once.observe(2, 25, 40.0, -30.0);
  const LinearizedProblem linearized(once);
  const auto dense = make_dense_system(linearized);
  const Damping damping{1e-3, DampingMatrix::kDiagonal};
  const VectorXd reference = solve_by_qr(dense, damping);
  Step step;
  ASSERT_TRUE(linearized.solve(options, damping, step).success);
  EXPECT_LT((flatten(dense, step) - reference).norm(), 1e-6 * reference.norm());
}

// V has rank two: without damping the step along the ray is anything; it must stay finite, and
// small enough for the model to hold.
TEST_P(LinearSolverLimits, APointSeenOnceHasAFiniteUndampedStep) {
  OwnedProblem once = scene();
  once.points.insert(once.points.end(), {0.5, -0.5, 0.25});
  once.fixed_points.push_back(0);
  once.observe(2, 25, 40.0, -30.0);
  const LinearizedProblem linearized(once, true);
  const auto dense = make_dense_system(linearized);
  Step step;
  ASSERT_TRUE(linearized.solve(options, {0.0, DampingMatrix::kIdentity}, step).success);
  ASSERT_TRUE(all_finite(step));
  const VectorXd flat = flatten(dense, step);
  EXPECT_LT(flat.tail<3>().norm(), 10.0);
  // The step of all others is the one without that observation.
  const LinearizedProblem without(scene(), true);
  Step other;
  ASSERT_TRUE(without.solve(options, {0.0, DampingMatrix::kIdentity}, other).success);
  const VectorXd expected = flatten(make_dense_system(without), other);
  EXPECT_LT((flat.head(expected.size()) - expected).norm(), 1e-6 * expected.norm());
}

TEST_P(LinearSolverLimits, WithEveryCameraFixedSolvesForThePointsAlone) {
  OwnedProblem intersection = scene(CameraModelId::kCalibrated);
  std::fill(intersection.fixed_cameras.begin(), intersection.fixed_cameras.end(), 1);
  const LinearizedProblem linearized(intersection);
  ASSERT_EQ(linearized.map.num_columns, 0);
  const auto dense = make_dense_system(linearized);
  const Damping damping{1e-3, DampingMatrix::kDiagonal};
  Step step;
  ASSERT_TRUE(linearized.solve(options, damping, step).success);
  const VectorXd reference = solve_by_qr(dense, damping);
  EXPECT_LT((flatten(dense, step) - reference).norm(), 1e-10 * reference.norm());
}

TEST_P(LinearSolverLimits, WithEveryPointFixedSolvesForTheCamerasAlone) {
  OwnedProblem resection = scene();
  std::fill(resection.fixed_points.begin(), resection.fixed_points.end(), 1);
  const LinearizedProblem linearized(resection);
  const auto dense = make_dense_system(linearized);
  const Damping damping{1e-3, DampingMatrix::kDiagonal};
  Step step;
  ASSERT_TRUE(linearized.solve(options, damping, step).success);
  const VectorXd reference = solve_by_qr(dense, damping);
  EXPECT_LT((flatten(dense, step) - reference).norm(), 1e-8 * reference.norm());
}

TEST_P(LinearSolverLimits, CamerasThatShareNoPointAreSolvedEachOnItsOwn) {
  support::SceneOptions scene_options = support::perturbed(CameraModelId::kCalibrated);
  scene_options.num_cameras = 4;
  OwnedProblem apart = make_circle_scene(scene_options);
  for (std::size_t k = apart.camera_index.size(); k-- > 0;) {
    if (apart.camera_index[k] % 2 == apart.point_index[k] % 2) continue;
    const auto at = static_cast<std::ptrdiff_t>(k);
    apart.camera_index.erase(apart.camera_index.begin() + at);
    apart.point_index.erase(apart.point_index.begin() + at);
    apart.pixels.erase(apart.pixels.begin() + 2 * at, apart.pixels.begin() + 2 * at + 2);
  }
  const LinearizedProblem linearized(apart);
  const auto dense = make_dense_system(linearized);
  const Damping damping{1e-3, DampingMatrix::kDiagonal};
  Step step;
  ASSERT_TRUE(linearized.solve(options, damping, step).success);
  const VectorXd reference = solve_by_qr(dense, damping);
  EXPECT_LT((flatten(dense, step) - reference).norm(), 1e-7 * reference.norm());
}

TEST_P(LinearSolverLimits, SolvesAgainForAnotherDampingAsIfItWereTheFirstTime) {
  const LinearizedProblem linearized(scene());
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

// Every point on the axis of its camera: k1 and k2 have no effect whatsoever.
TEST(DirectSolver, ReportsASystemThatIsNotPositiveDefinite) {
  OwnedProblem axis =
      support::make_circle_scene({.camera_model = CameraModelId::kBal, .num_points = 12});
  for (std::size_t p = 0; p < 12; ++p) {
    for (int k = 0; k < 3; ++k) axis.points[3 * p + k] = 0.0;
  }
  const LinearizedProblem linearized(axis, true);
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
  support::SceneOptions scene_options = support::perturbed(CameraModelId::kBal);
  scene_options.num_cameras = 30;
  scene_options.num_points = 150;
  scene_options.window = 4;
  const LinearizedProblem linearized(make_circle_scene(scene_options));
  const auto solver =
      make_linear_solver(linearized.normal(), {LinearSolverKind::kIterative, 1e-12, 100000});
  const Damping damping{1e-8, DampingMatrix::kDiagonal};
  Step whole, stopped;
  const int all = solver->solve(damping, whole, [] { return false; }).iterations;
  const LinearSolveResult early = solver->solve(damping, stopped, [] { return true; });
  EXPECT_TRUE(early.success);
  EXPECT_LT(early.iterations, all / 2);
  const double promise = linearized.normal().predicted_decrease(stopped, damping);
  EXPECT_GT(promise, 0.0);
  EXPECT_LT(promise, linearized.normal().predicted_decrease(whole, damping));
}

TEST(IterativeSolver, KeepsToItsLimitOfIterations) {
  const LinearizedProblem linearized(make_circle_scene(support::perturbed(CameraModelId::kBal)));
  Step step;
  const LinearSolverOptions options{LinearSolverKind::kIterative, 1e-15, 7};
  const auto result = linearized.solve(options, {1e-6, DampingMatrix::kDiagonal}, step);
  EXPECT_EQ(result.iterations, 7);
}

}  // namespace
}  // namespace sfmcpp::linear

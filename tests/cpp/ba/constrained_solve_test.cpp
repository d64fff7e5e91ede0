// What constraints do to a solve: they give scale and place, tie parts together, and weigh what
// they are told to weigh.
#include <algorithm>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "sfmcpp/cameras/matrix34.hpp"
#include "sfmcpp/math/so3.hpp"
#include "support/enumerators.hpp"
#include "support/random_constraints.hpp"

namespace sfmcpp::ba::constrained_solve_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using linear::LinearSolverKind;
using optim::Method;
using optim::State;
using support::OwnedProblem;
using Kind = residuals::ConstraintKind;

PoseMatrix pose(const State& state, int camera) {
  return Eigen::Map<const PoseMatrix>(state.cameras.data() + 12L * camera);
}

double worst_centre_error(const State& state, const State& truth) {
  double worst = 0.0;
  for (int i = 0; 12UL * i < truth.cameras.size(); ++i)
    worst = std::max(worst, (pose(state, i).col(3) - pose(truth, i).col(3)).norm());
  return worst;
}

// X ← s R X + t for the cameras [first, end) and the points [first_point, end_point).
void move(OwnedProblem& problem, int first, int end, int first_point, int end_point, double scale) {
  const Matrix3d r = exp_so3({0.02, -0.03, 0.05});
  const Vector3d t(0.4, -0.3, 0.2);
  for (int i = first; i < end; ++i) {
    Eigen::Map<PoseMatrix> m(problem.cameras.data() + 12L * i);
    m.leftCols<3>() = (r * m.leftCols<3>()).eval();
    m.col(3) = (scale * r * m.col(3) + t).eval();
  }
  for (int p = first_point; p < end_point; ++p) {
    Eigen::Map<Vector3d> x(problem.points.data() + 3L * p);
    x = (scale * r * x + t).eval();
  }
}

// Exact images; the start is off by a similarity.
OwnedProblem displaced_scene() {
  support::SceneOptions options;
  options.num_cameras = 8;
  options.num_points = 30;
  OwnedProblem problem = make_circle_scene(options);
  move(problem, 0, 8, 0, 30, 1.1);
  return problem;
}

residuals::ConstraintGroup exact(const OwnedProblem& problem,
                                 residuals::ConstraintKind kind,
                                 const std::vector<std::pair<int, int>>& cameras,
                                 double weight) {
  residuals::ConstraintGroup group = random_group(problem, kind, cameras, 0.0);
  group.weight = weight;
  return group;
}

std::vector<std::pair<int, int>> every_camera(int count) {
  std::vector<std::pair<int, int>> cameras;
  for (int i = 0; i < count; ++i) cameras.emplace_back(i == 0 ? 1 : i - 1, i);
  return cameras;
}

SolveOptions precise(Method method, LinearSolverKind solver = LinearSolverKind::kAuto) {
  SolveOptions options;
  options.minimizer.method = method;
  options.minimizer.termination.function_tolerance = 1e-15;
  options.minimizer.termination.max_iterations = 300;
  options.linear_solver.kind = solver;
  if (solver == LinearSolverKind::kAuto || solver == LinearSolverKind::kIterative)
    options.linear_solver = {solver, 1e-8, 5000};
  return options;
}

class PositionsOnly : public testing::TestWithParam<std::pair<Method, LinearSolverKind>> {};

TEST_P(PositionsOnly, RecoverMetricScaleAndPlaceWithEveryMethod) {
  OwnedProblem problem = displaced_scene();
  problem.constraints.add(exact(problem, Kind::kPosition, every_camera(8), 1e6));
  State state = state_of(problem.view());
  ASSERT_GT(worst_centre_error(state, problem.truth), 1.0);
  const SolveSummary summary =
      solve(problem.view(), precise(GetParam().first, GetParam().second), {}, state);
  EXPECT_LT(worst_centre_error(state, problem.truth), 1e-4) << summary.minimizer.message;
  ASSERT_EQ(summary.constraint_costs.size(), 1u);
  EXPECT_EQ(summary.constraint_costs[0].name, "position");
  EXPECT_NEAR(summary.constraint_costs[0].initial_cost / summary.minimizer.initial_cost, 1.0, 1e-9);
  EXPECT_LT(summary.constraint_costs[0].final_cost,
            1e-6 * summary.constraint_costs[0].initial_cost);
  EXPECT_LT(summary.initial_rms_px, 1e-9);  // a similarity is seen by no image
}

INSTANTIATE_TEST_SUITE_P(
    Methods,
    PositionsOnly,
    testing::Values(std::pair(Method::kLevenbergMarquardt, LinearSolverKind::kDense),
                    std::pair(Method::kLevenbergMarquardtNielsen, LinearSolverKind::kSparse),
                    std::pair(Method::kLevenbergMarquardtNielsen, LinearSolverKind::kIterative),
                    std::pair(Method::kGaussNewton, LinearSolverKind::kDense),
                    std::pair(Method::kDogLeg, LinearSolverKind::kSparse)),
    [](const auto& test) { return support::identifier_of(test.param.first, test.param.second); });

// Their steps see neither scale nor place, only what their diagonal blocks do.
class SlowMethod : public testing::TestWithParam<Method> {};

TEST_P(SlowMethod, LowersTheCostOfConstraintsToo) {
  OwnedProblem problem = displaced_scene();
  problem.constraints.add(exact(problem, Kind::kPosition, every_camera(8), 1e4));
  problem.constraints.add(exact(problem, Kind::kDisplacementPose, every_camera(8), 1e4));
  State state = state_of(problem.view());
  SolveOptions options;
  options.minimizer.method = GetParam();
  options.minimizer.termination.max_iterations = 100;
  const SolveSummary summary = solve(problem.view(), options, {}, state);
  EXPECT_LT(summary.minimizer.final_cost, 0.5 * summary.minimizer.initial_cost);
  for (const ConstraintGroupCost& group : summary.constraint_costs)
    EXPECT_LT(group.final_cost, group.initial_cost) << group.name;
}

INSTANTIATE_TEST_SUITE_P(Methods,
                         SlowMethod,
                         testing::Values(Method::kGradientDescent,
                                         Method::kConjugateGradient,
                                         Method::kAlternation),
                         [](const auto& test) { return support::identifier_of(test.param); });

// Cameras 0–3 see points 0–19, cameras 4–7 points 20–39.
OwnedProblem two_parts() {
  support::SceneOptions options;
  options.num_cameras = 8;
  options.num_points = 40;
  OwnedProblem all = make_circle_scene(options), problem = all;
  problem.camera_index.clear();
  problem.point_index.clear();
  problem.pixels.clear();
  for (std::size_t k = 0; k < all.camera_index.size(); ++k) {
    if ((all.camera_index[k] < 4) != (all.point_index[k] < 20)) continue;
    problem.observe(
        all.camera_index[k], all.point_index[k], all.pixels[2 * k], all.pixels[2 * k + 1]);
  }
  move(problem, 4, 8, 20, 40, 1.05);
  return problem;
}

TEST(DisplacementConstraints, TieTwoPartsThatShareNoPoint) {
  for (LinearSolverKind solver :
       {LinearSolverKind::kDense, LinearSolverKind::kSparse, LinearSolverKind::kIterative}) {
    OwnedProblem problem = two_parts();
    problem.fixed_cameras[0] = problem.fixed_cameras[1] = 1;  // gauge and scale of the first part
    problem.constraints.add(exact(problem, Kind::kDisplacementPose, {{3, 4}, {2, 5}, {6, 0}}, 1e4));
    State state = state_of(problem.view());
    const SolveSummary summary =
        solve(problem.view(), precise(Method::kLevenbergMarquardtNielsen, solver), {}, state);
    EXPECT_LT(worst_centre_error(state, problem.truth), 1e-4) << enum_name(solver);
    ASSERT_EQ(summary.warnings.size(), 1u);
    EXPECT_NE(summary.warnings[0].find("nothing but constraints relates"), std::string::npos);
  }
}

// A measurement that contradicts the images, at growing weights.
TEST(Weights, TheLargerTheCloserToTheMeasurement) {
  support::SceneOptions options;
  options.noise_px = 0.5;
  OwnedProblem problem = make_circle_scene(options);
  problem.fixed_cameras[0] = problem.fixed_cameras[3] = 1;
  residuals::ConstraintGroup group = exact(problem, Kind::kPosition, {{0, 1}}, 1.0);
  group.members[0].pose.translation += Vector3d(0.05, -0.1, 0.08);
  problem.constraints.add(group);
  double previous = std::numeric_limits<double>::infinity();
  for (double weight : {1.0, 1e4, 1e6, 1e8, 1e10}) {
    problem.constraints.set_weight("position", weight);
    State state = state_of(problem.view());
    solve(problem.view(), precise(Method::kLevenbergMarquardtNielsen), {}, state);
    const double distance = (pose(state, 1).col(3) - group.members[0].pose.translation).norm();
    EXPECT_LT(distance, previous) << "weight " << weight;
    previous = distance;
  }
  EXPECT_LT(previous, 1e-5);
}

State solved(const OwnedProblem& problem, LinearSolverKind solver, int threads) {
  SolveOptions options;
  options.linear_solver.kind = solver;
  options.num_threads = threads;
  options.minimizer.termination.max_iterations = 5;
  State state = state_of(problem.view());
  solve(problem.view(), options, {}, state);
  return state;
}

OwnedProblem large_scene() {
  support::SceneOptions options = support::perturbed(CameraModelId::kBal);
  options.num_cameras = 12;
  options.num_points = 600;
  options.window = 3;
  options.num_groups = 4;
  return make_circle_scene(options);
}

constexpr LinearSolverKind kSolvers[] = {
    LinearSolverKind::kDense, LinearSolverKind::kSparse, LinearSolverKind::kIterative};

TEST(Weights, ZeroGivesTheSameBitsAsNoConstraint) {
  const OwnedProblem without = large_scene();
  OwnedProblem with = large_scene();
  for (Kind kind : {Kind::kPosition, Kind::kDisplacementPose, Kind::kScale})
    with.constraints.add(random_group(with, kind, {{0, 5}, {3, 9}, {1, 2}}));
  with.constraints.set_weight("position", 0.0);
  with.constraints.set_weight("displacement-pose", 0.0);
  with.constraints.set_weight("scale", 0.0);
  for (LinearSolverKind solver : kSolvers) {
    const State reference = solved(without, solver, 1), state = solved(with, solver, 1);
    EXPECT_NE(reference.points, without.points);
    EXPECT_EQ(state.cameras, reference.cameras) << enum_name(solver);
    EXPECT_EQ(state.intrinsics, reference.intrinsics) << enum_name(solver);
    EXPECT_EQ(state.points, reference.points) << enum_name(solver);
  }
}

TEST(ConstrainedDeterminism, StatesHaveTheSameBitsForEveryNumberOfThreads) {
  OwnedProblem problem = large_scene();
  for (const residuals::ConstraintKind kind : support::pose_constraint_kinds())
    problem.constraints.add(random_group(problem, kind, {{0, 5}, {3, 9}, {1, 2}}));
  problem.constraints.add(
      random_group(problem, residuals::ConstraintKind::kFocal, {{0, 1}, {0, 2}}));
  for (LinearSolverKind solver : kSolvers) {
    const State reference = solved(problem, solver, 1);
    for (int threads : {2, 3, 5}) {
      const State state = solved(problem, solver, threads);
      EXPECT_EQ(state.cameras, reference.cameras) << threads << " threads";
      EXPECT_EQ(state.points, reference.points) << threads << " threads";
    }
  }
}

TEST(ConstrainedSolve, EquationsOfConstraintsCountAsResiduals) {
  support::SceneOptions options;
  options.num_cameras = 2;
  options.num_points = 4;
  OwnedProblem problem = make_circle_scene(options);  // 16 residuals, 24 unknowns, 7 of the world
  State state = state_of(problem.view());
  EXPECT_THROW(solve(problem.view(), {}, {}, state), InvalidArgument);
  problem.constraints.add(exact(problem, Kind::kPose, {{0, 0}, {1, 0}}, 1.0));
  EXPECT_NO_THROW(solve(problem.view(), {}, {}, state));
  problem.constraints.set_weight("pose", 0.0);
  EXPECT_THROW(solve(problem.view(), {}, {}, state), InvalidArgument);
}

TEST(ConstrainedSolve, AlgebraicSearchesLowerTheTrueCost) {
  for (optim::LineSearchKind search :
       {optim::LineSearchKind::kGlobalAlgebraic, optim::LineSearchKind::kTwoWayAlgebraic}) {
    OwnedProblem problem = displaced_scene();
    problem.constraints.add(exact(problem, Kind::kPosition, every_camera(8), 1e6));
    SolveOptions options = precise(Method::kLevenbergMarquardtNielsen);
    options.minimizer.line_search.kind = search;
    State state = state_of(problem.view());
    solve(problem.view(), options, {}, state);
    EXPECT_LT(worst_centre_error(state, problem.truth), 1e-4) << enum_name(search);
  }
}

}  // namespace
}  // namespace sfmcpp::ba::constrained_solve_test

// Cameras without observations: placed by constraints where these determine them.
#include "sfmcpp/ba/held_cameras.hpp"

#include <cmath>

#include <Eigen/Core>
#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "support/enumerators.hpp"
#include "support/random_constraints.hpp"
#include "support/refusal.hpp"

namespace sfmcpp::ba::held_cameras_test {
namespace {

using linear::LinearSolverKind;
using optim::Method;
using optim::State;
using support::OwnedProblem;
using Kind = residuals::ConstraintKind;
using Pairs = std::vector<std::pair<int, int>>;
using Held = std::vector<std::uint8_t>;

constexpr int kCameras = 10;

// Exact images, those of cameras 4, 5 and 6 missing; these three start elsewhere.
OwnedProblem scene_with_a_gap() {
  support::SceneOptions options;
  options.num_cameras = kCameras;
  options.num_points = 40;
  const OwnedProblem all = make_circle_scene(options);
  OwnedProblem problem = all;
  problem.camera_index.clear();
  problem.point_index.clear();
  problem.pixels.clear();
  for (std::size_t k = 0; k < all.camera_index.size(); ++k) {
    const int camera = all.camera_index[k];
    if (camera < 4 || camera > 6)
      problem.observe(camera, all.point_index[k], all.pixels[2 * k], all.pixels[2 * k + 1]);
  }
  for (int camera : {4, 5, 6}) {
    for (int row = 0; row < 3; ++row) problem.cameras[12UL * camera + 4 * row + 3] += 0.3 + row;
  }
  return problem;
}

void add_exact(OwnedProblem& problem, Kind kind, const Pairs& cameras, double weight = 1e4) {
  residuals::ConstraintGroup group = random_group(problem, kind, cameras, 0.0);
  group.weight = weight;
  problem.constraints.add(group);
}

Held held(const OwnedProblem& problem) {
  return cameras_held_by_constraints(
      problem.view(), graph_of(problem.view()), state_of(problem.view()));
}

double worst_error(const State& state, const State& truth) {
  double worst = 0.0;
  for (std::size_t k = 0; k < truth.cameras.size(); ++k)
    worst = std::max(worst, std::abs(state.cameras[k] - truth.cameras[k]));
  return worst;
}

TEST(HeldCameras, AreThoseThatAChainOfRelativePosesReaches) {
  OwnedProblem problem = scene_with_a_gap();
  EXPECT_EQ(held(problem), Held());
  add_exact(problem, Kind::kDisplacementPose, {{3, 4}, {4, 5}, {5, 6}});
  EXPECT_EQ(held(problem), (Held{0, 0, 0, 0, 1, 1, 1, 0, 0, 0}));
}

TEST(HeldCameras, SeveralConstraintsMayDetermineOneTogether) {
  OwnedProblem problem = scene_with_a_gap();
  add_exact(problem, Kind::kPosition, {{0, 4}, {0, 5}});
  EXPECT_EQ(held(problem), Held());  // the rotation is open: left as it is, as without constraints
  add_exact(problem, Kind::kOrientation, {{0, 5}, {0, 6}});
  EXPECT_EQ(held(problem), (Held{0, 0, 0, 0, 0, 1, 0, 0, 0, 0}));
}

TEST(HeldCameras, ThatConstraintsBetweenTwoLeaveOpenAreRefused) {
  OwnedProblem problem = scene_with_a_gap();
  add_exact(problem, Kind::kDisplacementPose, {{3, 4}, {5, 6}});  // 5 and 6 to nothing else
  support::expect_refused([&] { held(problem); },
                          {"constraints['displacement-pose'][1].cameras: camera 6 has no",
                           "must be observed, fixed or constrained further"});
  // Two distances and two turns over a gap of one camera leave its centre on a circle.
  problem = scene_with_a_gap();
  add_exact(problem, Kind::kScale, {{3, 4}, {4, 7}});
  add_exact(problem, Kind::kDisplacementRotationLog, {{3, 4}, {4, 7}});
  support::expect_refused([&] { held(problem); }, {"constraints['scale'][0].cameras: camera 4"});
}

TEST(HeldCameras, WeightsOfZeroHoldNothing) {
  OwnedProblem problem = scene_with_a_gap();
  add_exact(problem, Kind::kDisplacementPose, {{3, 4}, {4, 5}, {5, 6}}, 0.0);
  EXPECT_EQ(held(problem), Held());
}

TEST(HeldCameras, AFixedCameraNeedsNoHold) {
  OwnedProblem problem = scene_with_a_gap();
  problem.fixed_cameras[5] = 1;
  add_exact(problem, Kind::kDisplacementPose, {{4, 5}, {5, 6}});
  EXPECT_EQ(held(problem), (Held{0, 0, 0, 0, 1, 0, 1, 0, 0, 0}));
}

class SolveWithAGap : public testing::TestWithParam<std::pair<Method, LinearSolverKind>> {};

TEST_P(SolveWithAGap, PlacesTheCamerasWithoutImages) {
  OwnedProblem problem = scene_with_a_gap();
  add_exact(problem, Kind::kDisplacementPose, {{3, 4}, {4, 5}, {5, 6}, {6, 7}});
  problem.fixed_cameras[0] = problem.fixed_cameras[9] = 1;
  State state = state_of(problem.view());
  ASSERT_GT(worst_error(state, problem.truth), 1.0);
  SolveOptions options;
  options.minimizer.method = GetParam().first;
  options.minimizer.termination.function_tolerance = 1e-15;
  options.minimizer.termination.max_iterations = 200;
  options.linear_solver.kind = GetParam().second;
  if (GetParam().second == linear::LinearSolverKind::kIterative)
    options.linear_solver = {GetParam().second, 1e-8, 5000};
  const SolveSummary summary = solve(problem.view(), options, {}, state);
  EXPECT_LT(worst_error(state, problem.truth), 1e-6) << summary.minimizer.message;
  EXPECT_EQ(summary.warnings, std::vector<std::string>());
}

INSTANTIATE_TEST_SUITE_P(
    Methods,
    SolveWithAGap,
    testing::Values(std::pair(Method::kLevenbergMarquardt, LinearSolverKind::kDense),
                    std::pair(Method::kLevenbergMarquardtNielsen, LinearSolverKind::kSparse),
                    std::pair(Method::kLevenbergMarquardtNielsen, LinearSolverKind::kIterative),
                    std::pair(Method::kGaussNewton, LinearSolverKind::kDense),
                    std::pair(Method::kDogLeg, LinearSolverKind::kSparse)),
    [](const auto& test) { return support::identifier_of(test.param.first, test.param.second); });

TEST(HeldCameras, BitsDoNotDependOnThreads) {
  std::vector<State> states;
  for (int threads : {1, 3}) {
    OwnedProblem problem = scene_with_a_gap();
    add_exact(problem, Kind::kDisplacementPose, {{3, 4}, {4, 5}, {5, 6}});
    State state = state_of(problem.view());
    SolveOptions options;
    options.num_threads = threads;
    solve(problem.view(), options, {}, state);
    states.push_back(state);
  }
  EXPECT_EQ(states[0].cameras, states[1].cameras);
}

}  // namespace
}  // namespace sfmcpp::ba::held_cameras_test

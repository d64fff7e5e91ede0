// Outliers, points behind cameras, things that hang on nothing: solved or reported, never a NaN.
#include <algorithm>
#include <cmath>
#include <random>

#include <Eigen/Core>
#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "support/small_scenes.hpp"

namespace sfmcpp::ba::robustness_test {
namespace {

using optim::State;
using support::OwnedProblem;
using support::SceneOptions;

bool all_finite(const State& state) {
  const auto finite = [](const std::vector<double>& values) {
    return std::all_of(values.begin(), values.end(), [](double x) { return std::isfinite(x); });
  };
  return finite(state.cameras) && finite(state.intrinsics) && finite(state.points);
}

// Two cameras keep the truth, so that states can be compared without alignment.
OwnedProblem held_scene(const SceneOptions& options) {
  OwnedProblem scene = make_circle_scene(options);
  for (int i : {0, 1}) {
    scene.fixed_cameras[i] = 1;
    std::copy_n(scene.truth.cameras.begin() + 12 * i, 12, scene.cameras.begin() + 12 * i);
  }
  return scene;
}

double median_point_error(const State& state, const State& truth) {
  std::vector<double> errors;
  for (std::size_t k = 0; k < truth.points.size(); k += 3) {
    const Eigen::Map<const Eigen::Vector3d> found(&state.points[k]), exact(&truth.points[k]);
    errors.push_back((found - exact).norm());
  }
  std::nth_element(errors.begin(), errors.begin() + errors.size() / 2, errors.end());
  return errors[errors.size() / 2];
}

double error_with(LossKind loss, const OwnedProblem& scene) {
  SolveOptions options;
  options.loss = loss;
  if (options.is_robust()) options.loss_scale_px = efficient_scale(loss, 0.5);
  options.minimizer.termination.max_iterations = 200;
  State state = state_of(scene.view());
  solve(scene.view(), options, {}, state);
  return median_point_error(state, scene.truth);
}

TEST(RobustLosses, ComeCloserToTheTruthThanSquaresWhenTenPercentAreOutliers) {
  SceneOptions scene_options = support::perturbed(CameraModelId::kCalibrated);
  scene_options.point_error_m = scene_options.centre_error_m = 0.02;
  scene_options.rotation_error_rad = 0.002;
  OwnedProblem scene = held_scene(scene_options);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> gross(-60.0, 60.0);
  for (std::size_t k = 0; k < scene.pixels.size(); k += 20) {
    scene.pixels[k] += gross(random);
    scene.pixels[k + 1] += gross(random);
  }
  const double squared = error_with(LossKind::kSquared, scene);
  EXPECT_LT(error_with(LossKind::kHuber, scene), 0.5 * squared);
  EXPECT_LT(error_with(LossKind::kCauchy, scene), 0.3 * squared);
  EXPECT_LT(error_with(LossKind::kTukey, scene), 0.3 * squared);
}

// At the truth the residuals are the noise; the MAD of 3,000 numbers is good to 2 %.
TEST(AutomaticLossScale, RecoversSigmaAtTheTruthFromBothSides) {
  SceneOptions scene_options;
  scene_options.num_points = 250;
  scene_options.noise_px = 1.3;
  OwnedProblem scene = make_circle_scene(scene_options);
  for (std::size_t k = 0; k < scene.pixels.size(); k += 60) scene.pixels[k] += 500.0;
  for (LossKind loss : {LossKind::kHuber, LossKind::kCauchy, LossKind::kTukey}) {
    SolveOptions options;
    options.loss = loss;
    options.loss_scale_px.reset();
    options.minimizer.termination.max_iterations = 0;
    State state = state_of(scene.view());
    const double sigma =
        solve(scene.view(), options, {}, state).loss_scale_px / efficient_scale(loss, 1.0);
    EXPECT_GT(sigma, 1.3 * 0.93);
    EXPECT_LT(sigma, 1.3 * 1.1);
  }
}

// Of the observations that are right, over that of the solution that knows them, less one.
double excess_of_loss_auto(double share, unsigned seed, const std::vector<int>& lost = {}) {
  SceneOptions scene_options = support::perturbed(CameraModelId::kPerspective);
  scene_options.num_cameras = 12;
  scene_options.num_points = 150;
  scene_options.seed = seed;
  OwnedProblem scene = make_circle_scene(scene_options);
  const std::vector<bool> wrong = support::spoil(scene, share, seed);
  OwnedProblem right = scene;
  std::size_t kept = 0;
  for (std::size_t k = 0; k < wrong.size(); ++k) {
    if (wrong[k]) continue;
    right.camera_index[kept] = scene.camera_index[k];
    right.point_index[kept] = scene.point_index[k];
    for (int i : {0, 1}) right.pixels[2 * kept + i] = scene.pixels[2 * k + i];
    ++kept;
  }
  right.camera_index.resize(kept);
  right.point_index.resize(kept);
  right.pixels.resize(2 * kept);
  for (int point : lost) scene.points[3 * point] += 20.0;
  State best = state_of(right.view()), found = state_of(scene.view());
  SolveOptions options;
  options.minimizer.termination.max_iterations = 100;
  const double least = solve(right.view(), options, {}, best).minimizer.final_cost;
  options.loss = LossKind::kAuto;
  solve(scene.view(), options, {}, found);
  options.loss = LossKind::kSquared;
  options.minimizer.termination.max_iterations = 0;
  return solve(right.view(), options, {}, found).minimizer.final_cost / least - 1.0;
}

TEST(LossAuto, EndsWhereASolutionThatKnowsTheOutliersEnds) {
  for (unsigned seed : {1, 2, 3}) {
    for (double share : {0.1, 0.3, 0.5})
      EXPECT_LT(std::abs(excess_of_loss_auto(share, seed)), 0.01) << share << ", seed " << seed;
  }
}

TEST(LossAuto, LeavesASceneWithoutOutliersToLeastSquares) {
  for (unsigned seed : {1, 2, 3}) EXPECT_LT(std::abs(excess_of_loss_auto(0.0, seed)), 1e-6);
}

TEST(LossAuto, FindsPointsAgainThatOutliersHaveLedAway) {
  EXPECT_LT(std::abs(excess_of_loss_auto(0.3, 1, {3, 50, 101})), 0.01);
}

// Of points with three right views a wrong one agrees by chance with two again and again.
TEST(LossAuto, ComesToTheResidualsOfPointsThatFewSee) {
  SceneOptions scene_options = support::perturbed(CameraModelId::kPerspective);
  scene_options.num_cameras = 16;
  scene_options.num_points = 400;
  scene_options.window = 6;
  OwnedProblem scene = make_circle_scene(scene_options);
  support::spoil(scene, 0.5);
  SolveOptions options;
  options.loss = LossKind::kAuto;
  options.minimizer.termination.max_iterations = 100;
  State state = state_of(scene.view());
  EXPECT_LT(solve(scene.view(), options, {}, state).loss_scale_px, 10.0 * scene_options.noise_px);
}

TEST(LossAuto, RaisesTheCostWithTheScaleAloneAndReportsTheScaleItEndsWith) {
  SceneOptions scene_options = support::perturbed(CameraModelId::kPerspective);
  scene_options.num_cameras = 12;
  scene_options.num_points = 150;
  OwnedProblem scene = make_circle_scene(scene_options);
  support::spoil(scene, 0.3);
  SolveOptions options;
  options.loss = LossKind::kAuto;
  State state = state_of(scene.view());
  const SolveSummary summary = solve(scene.view(), options, {}, state);
  double before = summary.minimizer.initial_cost;
  int rises = 0;  // from the bulk of the residuals to their tails, and at three detours
  for (const optim::Iteration& now : summary.minimizer.iterations) {
    rises += now.cost > before ? 1 : 0;
    before = now.cost;
  }
  EXPECT_LE(rises, 4);
  EXPECT_LT(summary.minimizer.final_cost, summary.minimizer.initial_cost);
  EXPECT_LT(summary.loss_scale_px, 10.0);
  options.loss_scale_px = 25.0;
  state = state_of(scene.view());
  EXPECT_GE(solve(scene.view(), options, {}, state).loss_scale_px, 25.0);
}

TEST(BehindCamera, ObservationsAreCountedAndTheSolveStaysFinite) {
  SceneOptions scene_options = support::perturbed(CameraModelId::kBal);
  scene_options.noise_px = 0.1;
  OwnedProblem scene = held_scene(scene_options);
  // Beyond the circle opposite to camera 2, seen by all: behind some of them.
  for (int k = 0; k < 3; ++k)
    scene.points[3 * 5 + k] = 1.5 * scene.truth.cameras[12 * 2 + 4 * k + 3];
  int expected = 0;
  for (int i = 0; i < 6; ++i) {
    double depth = 0.0;
    for (int k = 0; k < 3; ++k) {
      const double* camera = scene.cameras.data() + 12 * i;
      depth += camera[4 * k + 2] * (scene.points[3 * 5 + k] - camera[4 * k + 3]);
    }
    expected += depth <= 0.0;
  }
  ASSERT_GT(expected, 0);
  State state = state_of(scene.view());
  const SolveSummary summary = solve(scene.view(), {}, {}, state);
  EXPECT_EQ(summary.behind_camera_initial, expected);
  EXPECT_TRUE(all_finite(state));
  EXPECT_LT(summary.minimizer.final_cost, summary.minimizer.initial_cost);
  ASSERT_FALSE(summary.warnings.empty());
  EXPECT_EQ(summary.warnings.back().substr(0, 30),
            std::to_string(expected) + " observations at the start an");
}

TEST(BehindCamera, APointInTheCentreOfACameraIsAFailureWithAMessageAndTheStateIsKept) {
  OwnedProblem scene = make_circle_scene(support::perturbed(CameraModelId::kBal));
  for (int k = 0; k < 3; ++k) scene.points[k] = scene.cameras[4 * k + 3];
  State state = state_of(scene.view());
  const SolveSummary summary = solve(scene.view(), {}, {}, state);
  EXPECT_EQ(summary.minimizer.termination, optim::Termination::kNumericalFailure);
  EXPECT_FALSE(summary.minimizer.message.empty());
  EXPECT_EQ(state.points, scene.points);
  EXPECT_EQ(state.cameras, scene.cameras);
}

class SolveWith : public testing::TestWithParam<linear::LinearSolverKind> {
 protected:
  SolveOptions options() const {
    SolveOptions result;
    result.linear_solver.kind = GetParam();
    result.minimizer.termination.function_tolerance = 1e-12;
    return result;
  }
};

TEST_P(SolveWith, ThingsWithoutObservationsStayAsGivenAndAreNamed) {
  OwnedProblem scene = make_circle_scene(support::perturbed(CameraModelId::kBal));
  for (std::size_t k = scene.camera_index.size(); k-- > 0;) {
    if (scene.camera_index[k] != 3 && scene.point_index[k] != 11) continue;
    const auto at = static_cast<std::ptrdiff_t>(k);
    scene.camera_index.erase(scene.camera_index.begin() + at);
    scene.point_index.erase(scene.point_index.begin() + at);
    scene.pixels.erase(scene.pixels.begin() + 2 * at, scene.pixels.begin() + 2 * at + 2);
  }
  State state = state_of(scene.view());
  const SolveSummary summary = solve(scene.view(), options(), {}, state);
  EXPECT_EQ(summary.minimizer.termination, optim::Termination::kConverged);
  EXPECT_LT(summary.final_rms_px, 0.6);
  for (int k = 0; k < 12; ++k) EXPECT_EQ(state.cameras[12 * 3 + k], scene.cameras[12 * 3 + k]);
  for (int k = 0; k < 3; ++k) EXPECT_EQ(state.points[33 + k], scene.points[33 + k]);
  for (int k = 0; k < 3; ++k) EXPECT_EQ(state.intrinsics[9 + k], scene.intrinsics[9 + k]);
  EXPECT_EQ(summary.warnings,
            (std::vector<std::string>{"camera 3: no observations, left as given",
                                      "point 11: no observations, left as given"}));
}

TEST_P(SolveWith, TwoScenesThatShareNothingAreBothSolved) {
  SceneOptions scene_options = support::perturbed(CameraModelId::kCalibrated);
  OwnedProblem both = make_circle_scene(scene_options);
  scene_options.seed = 2;
  const OwnedProblem other = make_circle_scene(scene_options);
  const auto append = [](auto& to, const auto& from) {
    to.insert(to.end(), from.begin(), from.end());
  };
  append(both.cameras, other.cameras);
  append(both.intrinsics, other.intrinsics);
  append(both.points, other.points);
  append(both.pixels, other.pixels);
  append(both.fixed_cameras, other.fixed_cameras);
  append(both.fixed_points, other.fixed_points);
  append(both.fixed_intrinsics, other.fixed_intrinsics);
  for (int i : other.intrinsics_index) both.intrinsics_index.push_back(6 + i);
  for (int i : other.camera_index) both.camera_index.push_back(6 + i);
  for (int p : other.point_index) both.point_index.push_back(40 + p);
  State state = state_of(both.view());
  const SolveSummary summary = solve(both.view(), options(), {}, state);
  EXPECT_EQ(summary.minimizer.termination, optim::Termination::kConverged);
  EXPECT_LT(summary.final_rms_px, 0.5);
  ASSERT_EQ(summary.warnings.size(), 1u);
  EXPECT_NE(summary.warnings[0].find("2 parts"), std::string::npos);
}

INSTANTIATE_TEST_SUITE_P(Kinds,
                         SolveWith,
                         testing::Values(linear::LinearSolverKind::kDense,
                                         linear::LinearSolverKind::kSparse,
                                         linear::LinearSolverKind::kIterative),
                         [](const auto& test) { return std::string(enum_name(test.param)); });

}  // namespace
}  // namespace sfmcpp::ba::robustness_test

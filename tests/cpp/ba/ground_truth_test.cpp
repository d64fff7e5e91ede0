// Solves against what made the data: the truth itself, its noise, and what was to stay as it is.
#include <cmath>
#include <ostream>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "support/small_scenes.hpp"

namespace sfmcpp::ba::ground_truth_test {
namespace {

using optim::Method;
using optim::State;
using support::OwnedProblem;
using support::SceneOptions;

SolveOptions precise() {
  SolveOptions options;
  options.minimizer.termination.function_tolerance = 1e-15;
  options.minimizer.termination.parameter_tolerance = 1e-15;
  options.minimizer.termination.max_iterations = 100;
  return options;
}

// Largest distance of points to the truth after the similarity that fits them best [m].
double point_error(const State& state, const State& truth) {
  const auto n = static_cast<Eigen::Index>(truth.points.size() / 3);
  const Eigen::Map<const Eigen::Matrix3Xd> found(state.points.data(), 3, n),
      exact(truth.points.data(), 3, n);
  const Eigen::Matrix4d fit = Eigen::umeyama(found, exact);
  const Eigen::Matrix3Xd moved =
      (fit.topLeftCorner<3, 3>() * found).colwise() + fit.topRightCorner<3, 1>();
  return (moved - exact).colwise().norm().maxCoeff();
}

struct Case {
  const char* name;
  CameraModelId model;
  int groups;
  std::vector<int> free;
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

class GroundTruth : public testing::TestWithParam<Case> {
 protected:
  SceneOptions scene_options(double noise_px) const {
    SceneOptions options = support::perturbed(GetParam().model);
    options.num_groups = GetParam().groups;
    options.free_intrinsics = GetParam().free;
    options.noise_px = noise_px;
    return options;
  }
};

TEST_P(GroundTruth, ExactDataGiveBackTheScene) {
  const OwnedProblem scene = make_circle_scene(scene_options(0.0));
  for (Gauge gauge : {Gauge::kFree, Gauge::kFixed}) {
    SolveOptions options = precise();
    options.gauge = gauge;
    State state = state_of(scene.view());
    ASSERT_GT(point_error(state, scene.truth), 0.05) << "the start is the solution";
    const SolveSummary summary = solve(scene.view(), options, {}, state);
    EXPECT_EQ(summary.minimizer.termination, optim::Termination::kConverged);
    EXPECT_LT(summary.minimizer.final_cost, 1e-16 * summary.minimizer.initial_cost);
    EXPECT_LT(point_error(state, scene.truth), 1e-6);
    for (std::size_t k = 0; k < state.intrinsics.size(); ++k) {
      const double scale = std::max(std::abs(scene.truth.intrinsics[k]), 1e-2);
      EXPECT_NEAR(state.intrinsics[k], scene.truth.intrinsics[k], 1e-6 * scale)
          << "intrinsic " << k;
    }
  }
}

// Of n residuals of variance σ², those at the minimum over u unknowns have Σ r² ≈ σ² (n − u); its
// relative standard deviation is √(2 / (n − u)), half of that for the root: 3 % here, bounds of
// four of them.
TEST_P(GroundTruth, NoisyDataEndAtTheNoiseFloorFromBothSides) {
  SceneOptions scene_noise = scene_options(0.7);
  scene_noise.varied_sigma = true;
  const OwnedProblem scene = make_circle_scene(scene_noise);
  State state = state_of(scene.view());
  const SolveSummary summary = solve(scene.view(), precise(), {}, state);
  const int groups = GetParam().groups > 0 ? GetParam().groups : 6;
  const double residuals = 2.0 * 6 * 40;
  const double unknowns = 6 * 6 + 3 * 40 - 7 + groups * static_cast<double>(GetParam().free.size());
  const double floor = 0.7 * std::sqrt(1.0 - unknowns / residuals);
  const double spread = 1.0 / std::sqrt(2.0 * (residuals - unknowns));
  EXPECT_GT(summary.final_rms_px, floor * (1.0 - 4 * spread));
  EXPECT_LT(summary.final_rms_px, floor * (1.0 + 4 * spread));
  EXPECT_NEAR(
      summary.minimizer.final_cost, 0.5 * residuals * std::pow(summary.final_rms_px, 2), 1e-9);
}

TEST_P(GroundTruth, GaugeFreeAndFixedEndAtTheSameCost) {
  const OwnedProblem scene = make_circle_scene(scene_options(0.5));
  SolveOptions options = precise();
  State free = state_of(scene.view()), fixed = free;
  options.gauge = Gauge::kFree;
  const double free_cost = solve(scene.view(), options, {}, free).minimizer.final_cost;
  options.gauge = Gauge::kFixed;
  const double fixed_cost = solve(scene.view(), options, {}, fixed).minimizer.final_cost;
  EXPECT_NEAR(free_cost / fixed_cost, 1.0, 1e-10);
  EXPECT_LT(point_error(free, fixed), 1e-4);
}

TEST_P(GroundTruth, FixedThingsDoNotMoveByASingleBit) {
  OwnedProblem scene = make_circle_scene(scene_options(0.5));
  scene.fixed_cameras[2] = scene.fixed_points[7] = 1;
  for (Gauge gauge : {Gauge::kFree, Gauge::kFixed}) {
    SolveOptions options = precise();
    options.gauge = gauge;
    const State start = state_of(scene.view());
    State state = start;
    solve(scene.view(), options, {}, state);
    for (int k = 0; k < 12; ++k) EXPECT_EQ(state.cameras[12 * 2 + k], start.cameras[12 * 2 + k]);
    for (int k = 0; k < 3; ++k) EXPECT_EQ(state.points[3 * 7 + k], start.points[3 * 7 + k]);
    EXPECT_NE(state.cameras[12 * 3 + 3], start.cameras[12 * 3 + 3]);
    EXPECT_NE(state.points[3 * 8], start.points[3 * 8]);
    for (std::size_t k = 0; k < state.intrinsics.size(); ++k) {
      EXPECT_EQ(state.intrinsics[k] == start.intrinsics[k], scene.fixed_intrinsics[k] != 0);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Scenes,
    GroundTruth,
    testing::Values(
        Case{"Calibrated", CameraModelId::kCalibrated, 0, {}},
        Case{"PerspectivePrivate", CameraModelId::kPerspective, 0, {0}},
        Case{"PerspectiveShared", CameraModelId::kPerspective, 2, {0, 2, 3, 5}},
        Case{"PerspectiveOneForAll", CameraModelId::kPerspective, 1, {0, 1, 2, 3, 5, 6, 10, 11}},
        Case{"BalPrivate", CameraModelId::kBal, 0, {0, 1, 2}},
        Case{"BalShared", CameraModelId::kBal, 3, {0, 1, 2}}),
    [](const auto& test) { return std::string(test.param.name); });

TEST(GaugeFixed, HoldsTheFirstPoseAndOneCoordinateOfAnother) {
  const OwnedProblem scene = make_circle_scene(support::perturbed(CameraModelId::kCalibrated));
  SolveOptions options = precise();
  options.gauge = Gauge::kFixed;
  const State start = state_of(scene.view());
  State state = start;
  solve(scene.view(), options, {}, state);
  for (int k = 0; k < 12; ++k) EXPECT_EQ(state.cameras[k], start.cameras[k]);
  EXPECT_EQ(state.cameras[12 * 3 + 3], start.cameras[12 * 3 + 3]);
  EXPECT_NE(state.cameras[12 * 3 + 7], start.cameras[12 * 3 + 7]);
}

TEST(Resection, OfOneCameraAgainstFixedPointsFindsItsPose) {
  SceneOptions scene_options = support::perturbed(CameraModelId::kCalibrated);
  scene_options.num_cameras = 1;
  scene_options.noise_px = 0.0;
  OwnedProblem scene = make_circle_scene(scene_options);
  scene.points = scene.truth.points;
  std::fill(scene.fixed_points.begin(), scene.fixed_points.end(), 1);
  for (Method method : {Method::kLevenbergMarquardt, Method::kGaussNewton}) {
    SolveOptions options = precise();
    options.minimizer.method = method;
    State state = state_of(scene.view());
    solve(scene.view(), options, {}, state);
    for (int k = 0; k < 12; ++k) EXPECT_NEAR(state.cameras[k], scene.truth.cameras[k], 1e-9);
  }
}

}  // namespace
}  // namespace sfmcpp::ba::ground_truth_test

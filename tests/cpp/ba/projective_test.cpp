// Bundle adjustment of uncalibrated cameras: what it finds, keeps and refuses.
#include <algorithm>
#include <cmath>

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "sfmcpp/core/error.hpp"
#include "support/small_scenes.hpp"

namespace sfmcpp::ba::projective_test {
namespace {

using Eigen::Matrix4d;
using Eigen::MatrixXd;
using Eigen::RowVector4d;
using Eigen::Vector4d;
using Eigen::VectorXd;
using optim::Method;
using optim::State;
using support::OwnedProblem;
using support::SceneOptions;

using Points = Eigen::Map<const Eigen::Matrix4Xd>;

Points points_of(const State& state) {
  return {state.points.data(), 4, static_cast<Eigen::Index>(state.points.size() / 4)};
}

SceneOptions scene_options(double noise_px) {
  SceneOptions options = support::perturbed(CameraModelId::kProjective);
  options.noise_px = noise_px;
  return options;
}

SolveOptions precise() {
  SolveOptions options;
  options.minimizer.termination.function_tolerance = 1e-15;
  options.minimizer.termination.parameter_tolerance = 1e-15;
  options.minimizer.termination.max_iterations = 200;
  return options;
}

// The H with H a ∝ b for every pair of points, in the least squares of the minors of (H a, b).
Matrix4d homography_between(const Points& a, const Points& b) {
  MatrixXd equations(6 * a.cols(), 16);
  Eigen::Index row = 0;
  for (Eigen::Index p = 0; p < a.cols(); ++p) {
    for (int i = 0; i < 4; ++i) {
      for (int j = i + 1; j < 4; ++j) {
        VectorXd equation = VectorXd::Zero(16);
        equation.segment<4>(4 * i) = b(j, p) * a.col(p);
        equation.segment<4>(4 * j) = -b(i, p) * a.col(p);
        equations.row(row++) = equation.transpose();
      }
    }
  }
  const Eigen::JacobiSVD<MatrixXd> svd(equations, Eigen::ComputeFullV);
  const VectorXd h = svd.matrixV().col(15);
  return Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(h.data());
}

// Largest distance of points to the truth after the homography that takes one to the other [m].
double point_error(const State& state, const State& truth) {
  const Points found = points_of(state), exact = points_of(truth);
  const Matrix4d h = homography_between(found, exact);
  double worst = 0.0;
  for (Eigen::Index p = 0; p < found.cols(); ++p) {
    const Vector4d moved = h * found.col(p), target = exact.col(p);
    worst = std::max(worst, (moved.hnormalized() - target.hnormalized()).norm());
  }
  return worst;
}

std::string message_of(const SolveOptions& options) {
  const OwnedProblem scene = make_circle_scene(scene_options(0.5));
  State state = state_of(scene.view());
  try {
    solve(scene.view(), options, {}, state);
  } catch (const InvalidArgument& error) {
    EXPECT_EQ(state.cameras, scene.cameras);
    return error.what();
  }
  return "no error";
}

TEST(ProjectiveAdjustment, ExactDataGiveBackTheSceneUpToAHomography) {
  const OwnedProblem scene = make_circle_scene(scene_options(0.0));
  for (Method method : {Method::kLevenbergMarquardt, Method::kLevenbergMarquardtNielsen}) {
    SolveOptions options = precise();
    options.minimizer.method = method;
    State state = state_of(scene.view());
    ASSERT_GT(point_error(state, scene.truth), 0.05) << "the start is the solution";
    const SolveSummary summary = solve(scene.view(), options, {}, state);
    EXPECT_EQ(summary.minimizer.termination, optim::Termination::kConverged);
    EXPECT_LT(summary.minimizer.final_cost, 1e-16 * summary.minimizer.initial_cost);
    EXPECT_LT(point_error(state, scene.truth), 1e-6);
  }
}

// The bounds of ground_truth_test.cpp, with eleven unknowns to a camera and fifteen of the gauge.
TEST(ProjectiveAdjustment, NoisyDataEndAtTheNoiseFloorFromBothSides) {
  SceneOptions noisy = scene_options(0.7);
  noisy.varied_sigma = true;
  const OwnedProblem scene = make_circle_scene(noisy);
  State state = state_of(scene.view());
  const SolveSummary summary = solve(scene.view(), precise(), {}, state);
  const double residuals = 2.0 * 6 * 40, unknowns = 11.0 * 6 + 3 * 40 - 15;
  const double floor = 0.7 * std::sqrt(1.0 - unknowns / residuals);
  const double spread = 1.0 / std::sqrt(2.0 * (residuals - unknowns));
  EXPECT_GT(summary.final_rms_px, floor * (1.0 - 4 * spread));
  EXPECT_LT(summary.final_rms_px, floor * (1.0 + 4 * spread));
}

// A calibrated reconstruction of the same images is one of the projective ones.
TEST(ProjectiveAdjustment, FitsTheImagesAtLeastAsWellAsTheCalibratedOne) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    SceneOptions options = scene_options(0.5);
    options.seed = seed;
    const OwnedProblem projective = make_circle_scene(options);
    options.camera_model = CameraModelId::kCalibrated;
    const OwnedProblem calibrated = make_circle_scene(options);
    ASSERT_EQ(projective.pixels, calibrated.pixels);
    State a = state_of(projective.view()), b = state_of(calibrated.view());
    const SolveSummary one = solve(projective.view(), precise(), {}, a);
    const SolveSummary other = solve(calibrated.view(), precise(), {}, b);
    EXPECT_NEAR(one.minimizer.initial_cost / other.minimizer.initial_cost, 1.0, 1e-9);
    EXPECT_LT(one.minimizer.final_cost, other.minimizer.final_cost);
    EXPECT_GT(one.minimizer.final_cost, 0.5 * other.minimizer.final_cost);
  }
}

TEST(ProjectiveAdjustment, EndsWithHomogeneousCoordinatesOfNormOne) {
  const OwnedProblem scene = make_circle_scene(scene_options(0.5));
  State state = state_of(scene.view());
  solve(scene.view(), {}, {}, state);
  for (std::size_t k = 0; k < state.cameras.size(); k += 12)
    EXPECT_NEAR(Eigen::Map<const VectorXd>(&state.cameras[k], 12).norm(), 1.0, 1e-14);
  for (double norm : points_of(state).colwise().norm()) EXPECT_NEAR(norm, 1.0, 1e-14);
}

// Nor do signs: any multiple of a camera or a point is the same camera and point.
TEST(ProjectiveAdjustment, ScalesOfTheStartDoNotMatter) {
  const OwnedProblem scene = make_circle_scene(scene_options(0.5));
  OwnedProblem scaled = scene;
  for (std::size_t k = 0; k < scaled.cameras.size(); ++k)
    scaled.cameras[k] *= 1000.0 * (1.0 + static_cast<double>(k / 12));
  for (std::size_t k = 0; k < scaled.points.size(); ++k)
    scaled.points[k] *= (k / 4 % 2 == 0 ? -1e-3 : 50.0);
  State a = state_of(scene.view()), b = state_of(scaled.view());
  const SolveSummary one = solve(scene.view(), {}, {}, a);
  const SolveSummary other = solve(scaled.view(), {}, {}, b);
  ASSERT_EQ(one.minimizer.iterations.size(), other.minimizer.iterations.size());
  EXPECT_NEAR(one.minimizer.final_cost / other.minimizer.final_cost, 1.0, 1e-9);
}

TEST(ProjectiveAdjustment, FixedThingsDoNotMoveByASingleBit) {
  OwnedProblem scene = make_circle_scene(scene_options(0.5));
  scene.fixed_cameras[2] = scene.fixed_points[7] = 1;
  for (int k = 0; k < 12; ++k) scene.cameras[12 * 2 + k] *= 3.0;
  for (int k = 0; k < 4; ++k) scene.points[4 * 7 + k] *= -0.1;
  const State start = state_of(scene.view());
  State state = start;
  const SolveSummary summary = solve(scene.view(), {}, {}, state);
  EXPECT_LT(summary.final_rms_px, 0.2 * summary.initial_rms_px);
  for (int k = 0; k < 12; ++k) EXPECT_EQ(state.cameras[12 * 2 + k], start.cameras[12 * 2 + k]);
  for (int k = 0; k < 4; ++k) EXPECT_EQ(state.points[4 * 7 + k], start.points[4 * 7 + k]);
  EXPECT_EQ(state.intrinsics, start.intrinsics);
  EXPECT_NE(state.cameras[12 * 3], start.cameras[12 * 3]);
  EXPECT_NE(state.points[4 * 8], start.points[4 * 8]);
}

TEST(ProjectiveAdjustment, AFixedGaugeIsRefusedWithTheReason) {
  SolveOptions options;
  options.gauge = Gauge::kFixed;
  const std::string message = message_of(options);
  EXPECT_EQ(message.substr(0, 28), "camera_model = 'projective':") << message;
  EXPECT_NE(message.find("15 degrees of freedom"), std::string::npos) << message;
  EXPECT_NE(message.find("gauge = 'fixed'"), std::string::npos) << message;
}

TEST(ProjectiveAdjustment, GaussNewtonIsRefusedWithTheReason) {
  SolveOptions options;
  options.minimizer.method = Method::kGaussNewton;
  const std::string message = message_of(options);
  EXPECT_EQ(message.substr(0, 28), "camera_model = 'projective':") << message;
  EXPECT_NE(message.find("method = 'gauss-newton'"), std::string::npos) << message;
}

}  // namespace
}  // namespace sfmcpp::ba::projective_test

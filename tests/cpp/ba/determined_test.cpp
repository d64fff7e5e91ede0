// Are there as many residuals as unknowns?
#include <algorithm>
#include <utility>
#include <vector>

#include <Eigen/QR>
#include <gtest/gtest.h>

#include "sfmcpp/ba/check.hpp"
#include "support/dense_reference.hpp"
#include "support/linearized_problem.hpp"
#include "support/refusal.hpp"

namespace sfmcpp::ba::determined_test {
namespace {

using support::message_of;
using support::OwnedProblem;

std::string check_counts(const OwnedProblem& scene) {
  const support::LinearizedProblem work(scene);
  return message_of([&] { check_determined(work.graph, work.map); });
}

TEST(CheckDetermined, CountsResidualsAgainstUnknownsExactly) {
  support::SceneOptions options;
  options.num_cameras = 2;
  options.num_points = 12;  // 48 residuals, 48 unknowns
  EXPECT_EQ(check_counts(make_circle_scene(options)), "no error");
  options.num_points = 11;  // 44, 45
  EXPECT_EQ(
      check_counts(make_circle_scene(options)),
      "fewer residuals than unknowns: 44 residuals, 45 unknowns; fix some or add observations");
}

std::string check_beside_freedoms(CameraModelId model, int num_points, bool hold_a_camera = false) {
  support::SceneOptions options;
  options.camera_model = model;
  options.num_cameras = 2;
  options.num_points = num_points;
  OwnedProblem scene = make_circle_scene(options);
  scene.fixed_cameras[0] = hold_a_camera ? 1 : 0;
  const support::LinearizedProblem work(scene);
  return message_of([&] {
    check_determined(work.graph, work.map, 0, this_process(), [&] {
      return num_world_freedoms(scene.view(), work.graph, state_of(scene.view()));
    });
  });
}

// Two views of five points tell their relative pose, the classic minimum, though 20 residuals are
// fewer than 27 unknowns: seven of these are where the world is, and how large.
TEST(CheckDetermined, FreedomsOfTheWorldAreNoUnknowns) {
  EXPECT_EQ(check_beside_freedoms(CameraModelId::kCalibrated, 5), "no error");
  EXPECT_EQ(check_beside_freedoms(CameraModelId::kCalibrated, 5, true), "no error");
  EXPECT_EQ(check_beside_freedoms(CameraModelId::kCalibrated, 4),
            "fewer residuals than unknowns: 16 residuals, 17 unknowns beside the 7 freedoms of the "
            "world; fix some or add observations");
}

// Seven are the minimum without calibration: 15 homographies of the world and the scales of two
// matrices are told by nothing.
TEST(CheckDetermined, FreedomsOfAProjectiveWorldAreNoUnknowns) {
  EXPECT_EQ(check_beside_freedoms(CameraModelId::kProjective, 7), "no error");
  EXPECT_EQ(
      check_beside_freedoms(CameraModelId::kProjective, 6),
      "fewer residuals than unknowns: 24 residuals, 25 unknowns beside the 17 freedoms of the "
      "world; fix some or add observations");
}

// What is fixed takes as many freedoms from the world as it has numbers, or all that are left.
TEST(CheckDetermined, AFixedCameraLeavesAProjectiveWorldFourHomographies) {
  EXPECT_EQ(check_beside_freedoms(CameraModelId::kProjective, 7, true), "no error");
  EXPECT_EQ(check_beside_freedoms(CameraModelId::kProjective, 6, true),
            "fewer residuals than unknowns: 24 residuals, 25 unknowns beside the 5 freedoms of the "
            "world; fix some or add observations");
}

// Directions of the unknowns along which the images do not change.
long num_unseen(const support::LinearizedProblem& work) {
  const Eigen::MatrixXd jacobian = support::make_dense_system(work).jacobian;
  return jacobian.cols() -
         Eigen::ColPivHouseholderQR<Eigen::MatrixXd>(jacobian).setThreshold(1e-9).rank();
}

TEST(CheckDetermined, FreedomsOfAProjectiveWorldAreWhatTheJacobianDoesNotSee) {
  support::SceneOptions options;
  options.camera_model = CameraModelId::kProjective;
  options.num_cameras = 4;
  const std::vector<std::pair<std::vector<int>, std::vector<int>>> fixed = {
      {{}, {}}, {{1}, {}}, {{0, 2}, {}}, {{}, {3}}, {{}, {3, 5, 7, 11, 13}}, {{2}, {4, 9}}};
  for (const auto& [cameras, points] : fixed) {
    OwnedProblem scene = make_circle_scene(options);
    for (int i : cameras) scene.fixed_cameras[i] = 1;
    for (int p : points) scene.fixed_points[p] = 1;
    const support::LinearizedProblem work(scene);
    EXPECT_EQ(num_world_freedoms(work.problem, work.graph, work.state), num_unseen(work))
        << cameras.size() << " cameras, " << points.size() << " points";
  }
}

TEST(CheckDetermined, FixedThingsAreNoUnknowns) {
  support::SceneOptions options;
  options.num_cameras = 2;
  options.num_points = 11;
  OwnedProblem scene = make_circle_scene(options);
  scene.fixed_points[4] = 1;
  EXPECT_EQ(check_counts(scene), "no error");
}

TEST(CheckDetermined, SaysWhenNothingIsObservedOrNothingIsFree) {
  OwnedProblem scene = support::make_circle_scene({});
  scene.camera_index.clear();
  scene.point_index.clear();
  scene.pixels.clear();
  scene.sigma_px.clear();
  const linear::ObservationGraph graph = graph_of(scene.view());
  const auto map = make_parameter_map(scene.view(), graph, free_intrinsics(scene.view(), graph));
  EXPECT_EQ(message_of([&] { check_determined(graph, map); }),
            "observations: there are none; constraints alone, a graph of poses, are not adjusted");

  OwnedProblem fixed = support::make_circle_scene({});
  for (auto* flags : {&fixed.fixed_cameras, &fixed.fixed_points, &fixed.fixed_intrinsics}) {
    std::fill(flags->begin(), flags->end(), 1);
  }
  EXPECT_EQ(check_counts(fixed),
            "nothing is free: every observed camera, intrinsic and point is fixed");
}

}  // namespace
}  // namespace sfmcpp::ba::determined_test

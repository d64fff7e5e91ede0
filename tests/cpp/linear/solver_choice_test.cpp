#include <cmath>

#include <gtest/gtest.h>

#include "sfmcpp/linear/linear_solver.hpp"
#include "support/linearized_problem.hpp"

namespace sfmcpp::linear {
namespace {

// Without the Jacobian, which the choice does not need.
struct Structure {
  explicit Structure(const support::SceneOptions& options)
      : scene(make_circle_scene(options)),
        graph(make_observation_graph(
            options.num_cameras, options.num_points, scene.camera_index, scene.point_index)),
        map(ba::make_parameter_map(
            scene.view(), graph, ba::free_intrinsics(scene.view(), graph), false)) {}

  LinearSolverChoice choose(LinearSolverKind requested = LinearSolverKind::kAuto) const {
    return choose_linear_solver(graph, map, requested);
  }

  support::OwnedProblem scene;
  ObservationGraph graph;
  ParameterMap map;
};

support::SceneOptions corridor(int cameras) {
  return {.camera_model = CameraModelId::kBal,
          .num_cameras = cameras,
          .num_points = 6 * cameras,
          .window = 4};
}

TEST(SolverChoice, IsDenseForFewCameras) {
  const Structure few({.camera_model = CameraModelId::kBal, .num_cameras = 20, .num_points = 300});
  EXPECT_EQ(few.choose().kind, LinearSolverKind::kDense);
}

TEST(SolverChoice, IsSparseForALongCorridor) {
  EXPECT_EQ(Structure(corridor(1000)).choose().kind, LinearSolverKind::kSparse);
}

TEST(SolverChoice, IsIterativeForManyCamerasThatAllSeeEachOther) {
  support::SceneOptions crowd{
      .camera_model = CameraModelId::kBal, .num_cameras = 3000, .num_points = 3000};
  crowd.window = 40;
  Structure structure(crowd);
  // Scatter the windows: every camera then shares points with almost every other.
  for (std::size_t k = 0; k < structure.scene.camera_index.size(); ++k) {
    structure.scene.camera_index[k] = static_cast<int>((k * 7919 + k / 40 * 31) % 3000);
  }
  structure.graph =
      make_observation_graph(3000, 3000, structure.scene.camera_index, structure.scene.point_index);
  EXPECT_EQ(structure.choose().kind, LinearSolverKind::kIterative);
}

TEST(SolverChoice, ReasonGivesTimeAndMemoryOfEverySolverConsidered) {
  const std::string reason = Structure(corridor(1000)).choose().reason;
  for (const char* name : {"dense ", "sparse ", "iterative "}) {
    const std::size_t at = reason.find(name);
    ASSERT_NE(at, std::string::npos) << reason;
    double milliseconds = 0.0, megabytes = 0.0;
    const std::string numbers = reason.substr(at + std::string(name).size());
    EXPECT_EQ(std::sscanf(numbers.c_str(), "%lf ms and %lf MB", &milliseconds, &megabytes), 2)
        << reason;
    EXPECT_GT(milliseconds, 0.0);
  }
}

TEST(SolverChoice, ARequestIsKept) {
  const Structure few(corridor(10));
  for (LinearSolverKind kind :
       {LinearSolverKind::kDense, LinearSolverKind::kSparse, LinearSolverKind::kIterative}) {
    EXPECT_EQ(few.choose(kind).kind, kind);
    EXPECT_EQ(few.choose(kind).reason, "as requested");
  }
}

}  // namespace
}  // namespace sfmcpp::linear

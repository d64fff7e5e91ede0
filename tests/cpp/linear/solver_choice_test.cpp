#include <cmath>

#include <gtest/gtest.h>

#include "sfmcpp/linear/linear_solver.hpp"
#include "support/random_system.hpp"

namespace sfmcpp::linear {
namespace {

using support::SystemOptions;

// Without the Jacobian, which the choice does not need.
struct Structure {
  explicit Structure(const SystemOptions& options)
      : graph(make_graph(options)), map(make_map(options)) {}

  LinearSolverChoice choose(LinearSolverKind requested = LinearSolverKind::kAuto) const {
    ThreadPool pool(1);
    return choose_linear_solver(graph, map, {.kind = requested}, pool);
  }

  ObservationGraph graph;
  ParameterMap map;
};

SystemOptions corridor(int cameras) {
  return {.cameras = cameras, .points = 6 * cameras, .camera_size = 9, .window = 4};
}

TEST(SolverChoice, IsDenseForFewCameras) {
  const Structure few({.cameras = 20, .points = 300, .camera_size = 9});
  EXPECT_EQ(few.choose().kind, LinearSolverKind::kDense);
}

TEST(SolverChoice, IsSparseForALongCorridor) {
  EXPECT_EQ(Structure(corridor(1000)).choose().kind, LinearSolverKind::kSparse);
}

TEST(SolverChoice, IsIterativeForManyCamerasThatAllSeeEachOther) {
  // Forty cameras a point, drawn from all: each shares points with almost every other.
  std::vector<int> cameras, points;
  for (int k = 0; k < 3000 * 40; ++k) {
    cameras.push_back((k * 7919 + k / 40 * 31) % 3000);
    points.push_back(k / 40);
  }
  Structure structure({.cameras = 3000, .points = 1, .camera_size = 9});
  structure.graph = make_observation_graph(3000, 3000, cameras, points);
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

TEST(SolverChoice, KeepsTheStructureThatItHadToMakeAndMakesNoneForARequest) {
  const Structure scene(corridor(1000));
  const LinearSolverChoice choice = scene.choose();
  ASSERT_NE(choice.structure, nullptr);
  EXPECT_EQ(choice.structure->pattern.num_rows(), 1000);
  EXPECT_EQ(choice.structure->ordering.position.size(), 1000u);
  EXPECT_EQ(Structure(corridor(20)).choose().structure, nullptr);
  EXPECT_EQ(scene.choose(LinearSolverKind::kSparse).structure, nullptr);
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

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include <gtest/gtest.h>

#include "sfmcpp/core/error.hpp"
#include "sfmcpp/linear/linear_solver.hpp"
#include "support/random_system.hpp"

namespace sfmcpp::linear::solver_choice_test {
namespace {

using support::SystemOptions;

// Without the Jacobian, which the choice does not need.
struct Structure {
  explicit Structure(const SystemOptions& options)
      : graph(make_graph(options)), map(make_map(options)) {}

  LinearSolverChoice choose(LinearSolverKind requested = LinearSolverKind::kAuto,
                            int threads = 1) const {
    return choose(LinearSolverOptions{.kind = requested}, threads);
  }
  LinearSolverChoice choose(const LinearSolverOptions& options,
                            int threads = 1,
                            double held_bytes = 0.0) const {
    ThreadPool pool(threads);
    return choose_linear_solver({.graph = graph,
                                 .map = map,
                                 .pool = pool,
                                 .pairs = {},
                                 .exchange = this_process(),
                                 .held_bytes = held_bytes},
                                options);
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

// Each point is seen by so many cameras, drawn from all.
Structure collection(int cameras, int points, int seen_by) {
  std::vector<int> all(cameras), camera, point;
  std::iota(all.begin(), all.end(), 0);
  std::mt19937 random(1);
  for (int p = 0; p < points; ++p) {
    std::shuffle(all.begin(), all.end(), random);
    camera.insert(camera.end(), all.begin(), all.begin() + seen_by);
    point.insert(point.end(), seen_by, p);
  }
  Structure structure({.cameras = cameras, .points = 1, .camera_size = 9});
  structure.graph = make_observation_graph(cameras, points, camera, point);
  return structure;
}

TEST(SolverChoice, IsIterativeForManyCamerasOfWhichAnyTwoMayMeet) {
  EXPECT_EQ(collection(3000, 3000, 40).choose().kind, LinearSolverKind::kIterative);
}

TEST(SolverChoice, IsIterativeForSomeHundredPhotosOfOnePlaceWhichTakeFewIterations) {
  const LinearSolverChoice choice = collection(200, 10000, 5).choose();
  EXPECT_EQ(choice.kind, LinearSolverKind::kIterative);
  EXPECT_TRUE(choice.with_blocks);
  EXPECT_LT(choice.counts.expected_iterations, 20);
  EXPECT_EQ(
      std::ranges::count(choice.forecasts, LinearSolverKind::kIterative, &SolverForecast::kind), 2);
  EXPECT_EQ(collection(50, 2500, 5).choose().kind, LinearSolverKind::kDense);
  EXPECT_NE(Structure(corridor(200)).choose().kind, LinearSolverKind::kIterative);
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

TEST(SolverChoice, KeepsTheStructureThatItHadToMakeAndMakesNoneThatNobodyNeeds) {
  const Structure scene(corridor(1000));
  const LinearSolverChoice choice = scene.choose();
  ASSERT_NE(choice.structure, nullptr);
  EXPECT_EQ(choice.structure->pattern.num_rows(), 1000);
  EXPECT_EQ(choice.structure->ordering.position.size(), 1000u);
  EXPECT_EQ(Structure(corridor(20)).choose().structure, nullptr);
  EXPECT_EQ(scene.choose(LinearSolverKind::kDense).structure, nullptr);
}

TEST(SolverChoice, IsTheSameForEveryNumberOfThreads) {
  for (int cameras : {20, 200, 1000}) {
    const Structure scene(corridor(cameras));
    const LinearSolverChoice one = scene.choose();
    for (int threads : {2, 5}) {
      const LinearSolverChoice other = scene.choose(LinearSolverKind::kAuto, threads);
      EXPECT_EQ(other.kind, one.kind);
      EXPECT_EQ(other.reason, one.reason);
      ASSERT_EQ(other.forecasts.size(), one.forecasts.size());
      for (std::size_t k = 0; k < one.forecasts.size(); ++k)
        EXPECT_EQ(other.forecasts[k].step, one.forecasts[k].step);
    }
  }
}

const SolverForecast& forecast_of(const LinearSolverChoice& choice, LinearSolverKind kind) {
  return *std::ranges::find(choice.forecasts, kind, &SolverForecast::kind);
}

TEST(SolverChoice, AMemoryLimitIsObeyedByASolverThatNeedsLess) {
  const Structure scene(corridor(1000));
  const LinearSolverChoice choice = scene.choose();
  ASSERT_EQ(choice.kind, LinearSolverKind::kSparse);
  const double held = 1e6;
  const double sparse = held + forecast_of(choice, LinearSolverKind::kSparse).bytes;
  EXPECT_EQ(scene.choose({.max_memory_bytes = sparse + 1}, 1, held).kind,
            LinearSolverKind::kSparse);
  EXPECT_EQ(scene.choose({.max_memory_bytes = sparse - 1}, 1, held).kind,
            LinearSolverKind::kIterative);
}

std::string refusal_of(const Structure& scene, const LinearSolverOptions& options, double held) {
  try {
    scene.choose(options, 1, held);
  } catch (const InvalidArgument& error) {
    return error.what();
  }
  return "";
}

TEST(SolverChoice, AMemoryLimitBelowTheLeanestSolverIsRefusedWithWhatThatNeeds) {
  const Structure scene(corridor(1000));
  const std::string refusal = refusal_of(scene, {.max_memory_bytes = 4e6}, 7e9);
  EXPECT_NE(refusal.find("max_memory_bytes = 4000000:"), std::string::npos) << refusal;
  EXPECT_NE(refusal.find("'iterative', would need 70"), std::string::npos) << refusal;
}

TEST(SolverChoice, ASolverAskedForByNameThatNeedsMoreIsRefusedAndTheLeanestNamed) {
  const Structure scene(corridor(1000));  // half of 9000² doubles
  const std::string refusal =
      refusal_of(scene, {.kind = LinearSolverKind::kDense, .max_memory_bytes = 1e8}, 0.0);
  EXPECT_NE(refusal.find("'dense' would need 32"), std::string::npos) << refusal;
  EXPECT_NE(refusal.find("'iterative'"), std::string::npos) << refusal;
  EXPECT_EQ(refusal_of(scene, {.kind = LinearSolverKind::kDense, .max_memory_bytes = 1e9}, 0.0),
            "");
}

// Few cameras see many points: the dense matrix takes less memory than what conjugate gradients
// keep of the points, and more time.
const Structure& few_cameras_and_many_points() {
  static const Structure scene({.cameras = 20, .points = 16000, .camera_size = 18});
  return scene;
}

TEST(SolverChoice, AMemoryLimitIsObeyedByASolverThatTakesMoreTime) {
  const Structure& scene = few_cameras_and_many_points();
  const LinearSolverChoice choice = scene.choose();
  ASSERT_EQ(choice.kind, LinearSolverKind::kIterative);
  ASSERT_LT(forecast_of(choice, LinearSolverKind::kDense).bytes, 1.1e6);
  ASSERT_GT(forecast_of(choice, LinearSolverKind::kIterative).bytes, 1.2e6);
  EXPECT_EQ(scene.choose({.max_memory_bytes = 1.1e6}).kind, LinearSolverKind::kDense);
}

TEST(SolverChoice, TheLeanestSolverMayBeTheDenseOne) {
  const Structure& scene = few_cameras_and_many_points();
  const std::string of_all = refusal_of(scene, {.max_memory_bytes = 1e5}, 0.0);
  EXPECT_NE(of_all.find(": the leanest, 'dense', would need 0.6 MB"), std::string::npos) << of_all;
  const std::string of_dense =
      refusal_of(scene, {.kind = LinearSolverKind::kDense, .max_memory_bytes = 1e5}, 0.0);
  EXPECT_EQ(of_dense, of_all);
  const std::string of_iterative =
      refusal_of(scene, {.kind = LinearSolverKind::kIterative, .max_memory_bytes = 1e5}, 0.0);
  EXPECT_NE(
      of_iterative.find("'iterative' would need 1.3 MB, and the leanest, 'dense', would need"),
      std::string::npos)
      << of_iterative;
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
}  // namespace sfmcpp::linear::solver_choice_test

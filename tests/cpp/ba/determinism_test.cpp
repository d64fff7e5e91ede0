// The same bits for every run and every number of threads.
#include <ostream>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "support/linearized_problem.hpp"

namespace sfmcpp::ba::determinism_test {
namespace {

using linear::LinearSolverKind;
using optim::State;

struct Case {
  const char* name;
  LinearSolverKind solver;
  int groups;
  LossKind loss;
  CameraModelId model = CameraModelId::kBal;
  optim::LineSearchKind search = optim::LineSearchKind::kNone;
  optim::Acceleration acceleration = optim::Acceleration::kNone;
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

class Determinism : public testing::TestWithParam<Case> {
 protected:
  // Cameras with more than one chunk of observations, and points of more than one task.
  static support::OwnedProblem scene() {
    support::SceneOptions options = support::perturbed(GetParam().model);
    options.num_cameras = 12;
    options.num_points = 1300;
    options.window = 6;
    options.num_groups = GetParam().groups;
    return make_circle_scene(options);
  }
  static State solved(const support::OwnedProblem& problem, int threads) {
    SolveOptions options;
    options.num_threads = threads;
    options.linear_solver.kind = GetParam().solver;
    options.loss = GetParam().loss;
    options.minimizer.line_search.kind = GetParam().search;
    options.minimizer.acceleration = GetParam().acceleration;
    options.minimizer.termination.max_iterations = 4;
    options.minimizer.termination.function_tolerance = 0.0;
    State state = state_of(problem.view());
    const SolveSummary summary = solve(problem.view(), options, {}, state);
    EXPECT_EQ(summary.num_threads, threads);
    return state;
  }
};

TEST_P(Determinism, StatesHaveTheSameBitsForEveryNumberOfThreadsAndEveryRun) {
  const support::OwnedProblem problem = scene();
  const State reference = solved(problem, 1);
  ASSERT_NE(reference.points, problem.points);
  for (int threads : {1, 2, 3, 5, 2}) {
    const State state = solved(problem, threads);
    EXPECT_EQ(state.cameras, reference.cameras) << threads << " threads";
    EXPECT_EQ(state.intrinsics, reference.intrinsics) << threads << " threads";
    EXPECT_EQ(state.points, reference.points) << threads << " threads";
  }
}

// They share the arrays of the problem, and one pool at a time is left for the next of them.
TEST_P(Determinism, SolvesOfSeveralThreadsAtOnceHaveTheBitsOfOneAlone) {
  constexpr int kCallers = 4, kSolvesOfEach = 3;
  const support::OwnedProblem problem = scene();
  const State reference = solved(problem, 1);
  std::vector<State> states(kCallers * kSolvesOfEach);
  std::vector<std::thread> callers;
  for (int caller = 0; caller < kCallers; ++caller) {
    callers.emplace_back([&, caller] {
      for (int k = 0; k < kSolvesOfEach; ++k)
        states[caller * kSolvesOfEach + k] = solved(problem, 1 + (caller + k) % 3);
    });
  }
  for (std::thread& caller : callers) caller.join();
  for (const State& state : states) {
    EXPECT_EQ(state.cameras, reference.cameras);
    EXPECT_EQ(state.intrinsics, reference.intrinsics);
    EXPECT_EQ(state.points, reference.points);
  }
}

// Many cameras add to the same entries of the few columns that they share. With the gauge fixed
// there are no more variable blocks than cameras.
TEST(SharedIntrinsics, OneRowOfIntrinsicsForAllGivesTheSameBitsWhateverIsFixed) {
  support::SceneOptions options = support::perturbed(CameraModelId::kPerspective);
  options.num_groups = 1;
  options.num_cameras = 60;
  options.num_points = 100;
  options.free_intrinsics = std::vector<int>{0, 1, 2, 3, 5, 6, 10, 11};
  const support::OwnedProblem scene = make_circle_scene(options);
  const linear::Damping damping{1e-3, linear::DampingMatrix::kDiagonal};
  for (bool fix_gauge : {false, true}) {
    linear::Step reference;
    for (int threads : {1, 2, 3, 5}) {
      const support::LinearizedProblem work(scene, fix_gauge, threads);
      for (int repeat = 0; repeat < 2; ++repeat) {
        linear::Step step;
        ASSERT_TRUE(work.solve({LinearSolverKind::kDense}, damping, step).success);
        if (threads == 1) reference = step;
        ASSERT_EQ(step.camera, reference.camera) << threads << " threads";
        ASSERT_EQ(step.point, reference.point) << threads << " threads";
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Solvers,
    Determinism,
    testing::Values(Case{"Dense", LinearSolverKind::kDense, 0, LossKind::kSquared},
                    Case{"DenseShared", LinearSolverKind::kDense, 3, LossKind::kHuber},
                    Case{"Sparse", LinearSolverKind::kSparse, 0, LossKind::kSquared},
                    Case{"SparseShared", LinearSolverKind::kSparse, 3, LossKind::kTukey},
                    Case{"Iterative", LinearSolverKind::kIterative, 0, LossKind::kSquared},
                    Case{"IterativeShared", LinearSolverKind::kIterative, 3, LossKind::kCauchy},
                    Case{"DenseAlgebraicSearch",
                         LinearSolverKind::kDense,
                         3,
                         LossKind::kHuber,
                         CameraModelId::kBal,
                         optim::LineSearchKind::kTwoWayAlgebraic},
                    Case{"ProjectiveAlgebraicSearch",
                         LinearSolverKind::kDense,
                         0,
                         LossKind::kSquared,
                         CameraModelId::kProjective,
                         optim::LineSearchKind::kGlobalAlgebraic},
                    Case{"ProjectiveSlopeSearch",
                         LinearSolverKind::kSparse,
                         0,
                         LossKind::kTukey,
                         CameraModelId::kProjective,
                         optim::LineSearchKind::kSoft},
                    Case{"SparseAccelerated",
                         LinearSolverKind::kSparse,
                         3,
                         LossKind::kHuber,
                         CameraModelId::kBal,
                         optim::LineSearchKind::kNone,
                         optim::Acceleration::kGeodesic},
                    Case{"IterativePointsAccelerated",
                         LinearSolverKind::kIterative,
                         0,
                         LossKind::kSquared,
                         CameraModelId::kProjective,
                         optim::LineSearchKind::kNone,
                         optim::Acceleration::kPoints}),
    [](const auto& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace sfmcpp::ba::determinism_test

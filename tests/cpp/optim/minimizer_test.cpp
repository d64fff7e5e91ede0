// The loop, on a bundle adjustment problem small enough to solve in a millisecond.
#include "sfmcpp/optim/minimizer.hpp"

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "support/linearized_problem.hpp"

namespace sfmcpp::optim::minimizer_test {
namespace {

using support::LinearizedProblem;

class Minimize : public testing::Test {
 protected:
  static support::SceneOptions start() {
    support::SceneOptions scene = support::perturbed(CameraModelId::kBal);
    scene.num_points = 30;
    return scene;
  }
  Minimize() { options.method = Method::kLevenbergMarquardt; }

  MinimizerSummary run() {
    const auto solver =
        linear::make_linear_solver(work.normal(), {linear::LinearSolverKind::kDense});
    const Stopwatch clock;
    return minimize(work.model, *solver, options, events, clock, state);
  }
  double cost() { return work.model.cost(state); }

  LinearizedProblem work{support::make_circle_scene(start())};
  State state = work.state;
  MinimizerOptions options;
  Events events;
};

// A start so far off that some steps are rejected on the way.
class MinimizeFarStart : public Minimize {
 protected:
  MinimizeFarStart() {
    for (double& x : state.points) x *= 2.5;
    options.initial_damping = 1e-12;
    options.point_steps = PointSteps::kWhole;
    options.termination.max_iterations = 200;
  }
};

TEST_F(MinimizeFarStart, RejectedStepsLeaveTheCostAndAcceptedOnesLowerIt) {
  for (Method method : {Method::kLevenbergMarquardt, Method::kLevenbergMarquardtNielsen}) {
    options.method = method;
    const State before = state;
    const MinimizerSummary summary = run();
    int rejected = 0;
    for (std::size_t k = 1; k < summary.iterations.size(); ++k) {
      const Iteration& now = summary.iterations[k];
      const double previous = summary.iterations[k - 1].cost;
      EXPECT_TRUE(now.accepted ? now.cost < previous : now.cost == previous);
      rejected += !now.accepted;
    }
    EXPECT_GT(rejected, 0) << "the start is too easy to show anything";
    EXPECT_LT(summary.final_cost, 0.01 * summary.initial_cost);
    state = before;
  }
}

TEST_F(MinimizeFarStart, ARejectedStepLeavesTheState) {
  bool was_rejected = false;
  State after_previous = state;
  events.on_iteration = [&](const Iteration& now) {
    if (!now.accepted) {
      was_rejected = true;
      EXPECT_EQ(state.points, after_previous.points);
      EXPECT_EQ(state.cameras, after_previous.cameras);
      EXPECT_EQ(state.intrinsics, after_previous.intrinsics);
    }
    after_previous = state;
    return Signal::kContinue;
  };
  run();
  EXPECT_TRUE(was_rejected);
}

TEST_F(MinimizeFarStart, DampingOfTheRecordIsThatOfTheStep) {
  const MinimizerSummary summary = run();
  EXPECT_EQ(summary.iterations.at(1).damping, 1e-12);
  for (std::size_t k = 2; k < summary.iterations.size(); ++k) {
    const double factor = summary.iterations[k - 1].accepted ? 0.1 : 10.0;
    const double previous = summary.iterations[k - 1].damping;
    EXPECT_NEAR(summary.iterations[k].damping / std::max(previous * factor, 1e-16), 1.0, 1e-12);
  }
}

TEST_F(Minimize, IterationZeroIsTheStart) {
  const double initial = cost();
  const MinimizerSummary summary = run();
  const Iteration& zero = summary.iterations.at(0);
  EXPECT_EQ(zero.number, 0);
  EXPECT_EQ(zero.cost, initial);
  EXPECT_EQ(summary.initial_cost, initial);
  EXPECT_TRUE(zero.accepted);
  EXPECT_EQ(zero.step_norm, 0.0);
  EXPECT_GT(zero.gradient_norm, 0.0);
  for (std::size_t k = 0; k < summary.iterations.size(); ++k) {
    EXPECT_EQ(summary.iterations[k].number, static_cast<int>(k));
  }
}

TEST_F(Minimize, FinalCostIsThatOfTheStateAndOfTheLastRecord) {
  const MinimizerSummary summary = run();
  EXPECT_EQ(summary.final_cost, cost());
  EXPECT_EQ(summary.iterations.back().cost, summary.final_cost);
  EXPECT_EQ(summary.termination, Termination::kConverged);
}

TEST_F(Minimize, TimesNeverGoBack) {
  const MinimizerSummary summary = run();
  for (std::size_t k = 1; k < summary.iterations.size(); ++k) {
    EXPECT_GE(summary.iterations[k].seconds, summary.iterations[k - 1].seconds);
  }
}

TEST_F(Minimize, LimitOnIterationsReturnsTheBestStateSoFar) {
  for (int limit : {0, 1, 2}) {
    state = work.state;
    options.termination.max_iterations = limit;
    const MinimizerSummary summary = run();
    EXPECT_EQ(summary.termination, Termination::kMaxIterations);
    EXPECT_EQ(summary.iterations.size(), static_cast<std::size_t>(limit) + 1);
    EXPECT_EQ(summary.final_cost, cost());
    EXPECT_LE(summary.final_cost, summary.initial_cost);
  }
  EXPECT_NE(state.points, work.state.points);
}

TEST_F(Minimize, TimeLimitReturnsTheBestStateSoFar) {
  options.termination.max_seconds = 1e-9;
  const MinimizerSummary summary = run();
  EXPECT_EQ(summary.termination, Termination::kMaxSeconds);
  EXPECT_EQ(summary.iterations.size(), 1u);
  EXPECT_EQ(summary.final_cost, cost());
}

TEST_F(Minimize, CallbackStopsAndInterruptsAndTheBestStateIsKept) {
  for (const auto& [signal, termination] :
       {std::pair{Signal::kStop, Termination::kStoppedByCallback},
        std::pair{Signal::kInterrupt, Termination::kInterrupted}}) {
    state = work.state;
    events.on_iteration = [s = signal](const Iteration& now) {
      return now.number == 2 ? s : Signal::kContinue;
    };
    const MinimizerSummary summary = run();
    EXPECT_EQ(summary.termination, termination);
    EXPECT_EQ(summary.iterations.size(), 3u);
    EXPECT_LT(summary.final_cost, summary.initial_cost);
    EXPECT_EQ(summary.final_cost, cost());
  }
}

TEST_F(Minimize, PollWithinALongLinearSolveInterruptsIt) {
  const auto solver = linear::make_linear_solver(
      work.normal(), {linear::LinearSolverKind::kIterative, 1e-14, 100000});
  int polls = 0;
  events.poll = [&] { return ++polls >= 2 ? Signal::kInterrupt : Signal::kContinue; };
  const Stopwatch clock;
  const MinimizerSummary summary = minimize(work.model, *solver, options, events, clock, state);
  EXPECT_EQ(summary.termination, Termination::kInterrupted);
  EXPECT_EQ(polls, 2);
  EXPECT_EQ(summary.final_cost, cost());
}

TEST_F(Minimize, AStartThatIsNotFiniteIsANumericalFailure) {
  state.points[4] = std::numeric_limits<double>::quiet_NaN();
  const State before = state;
  const MinimizerSummary summary = run();
  EXPECT_EQ(summary.termination, Termination::kNumericalFailure);
  EXPECT_EQ(state.cameras, before.cameras);
  EXPECT_FALSE(summary.message.empty());
}

// A second step that counts as negligible, though the first was none and much is still to gain.
TEST_F(Minimize, StepsThatBecomeNegligibleFarFromAMinimumAreAStall) {
  options.termination.function_tolerance = 0.0;
  const State start = state;
  const MinimizerSummary whole = run();
  ASSERT_LT(whole.iterations[2].step_norm, whole.iterations[1].step_norm);
  double squares = 0.0;
  for (const auto& numbers : {start.cameras, start.intrinsics, start.points})
    for (double x : numbers) squares += x * x;
  options.termination.parameter_tolerance =
      std::sqrt(whole.iterations[1].step_norm * whole.iterations[2].step_norm / squares);
  state = start;
  const MinimizerSummary stalled = run();
  EXPECT_EQ(stalled.termination, Termination::kStalled);
  EXPECT_GT(stalled.final_cost, 1.01 * whole.final_cost);
  EXPECT_LT(stalled.final_cost, stalled.initial_cost);
}

TEST_F(Minimize, AnOptimalStartConvergesAtOnceAndStays) {
  options.termination.function_tolerance = 1e-14;
  run();
  const State optimum = state;
  const double optimal_cost = cost();
  options.termination.function_tolerance = 1e-6;
  const MinimizerSummary again = run();
  EXPECT_EQ(again.termination, Termination::kConverged);
  EXPECT_LE(again.iterations.size(), 3u);
  EXPECT_NEAR(again.final_cost, optimal_cost, 1e-9 * optimal_cost);
  double moved = 0.0;
  for (std::size_t k = 0; k < state.points.size(); ++k) {
    moved = std::max(moved, std::abs(state.points[k] - optimum.points[k]));
  }
  EXPECT_LT(moved, 1e-4);
}

TEST_F(Minimize, ExactDataAtTheTruthHasNoGradientToFollow) {
  support::SceneOptions exact;
  exact.camera_model = CameraModelId::kCalibrated;
  LinearizedProblem at_truth{support::make_circle_scene(exact)};
  const auto solver =
      linear::make_linear_solver(at_truth.normal(), {linear::LinearSolverKind::kDense});
  const Stopwatch clock;
  const State before = at_truth.state;
  const auto summary = minimize(at_truth.model, *solver, options, events, clock, at_truth.state);
  EXPECT_EQ(summary.termination, Termination::kConverged);
  EXPECT_EQ(summary.iterations.size(), 1u);
  EXPECT_EQ(at_truth.state.points, before.points);
}

TEST_F(Minimize, ATighterFunctionToleranceGoesFurther) {
  options.termination.function_tolerance = 1e-2;
  const MinimizerSummary coarse = run();
  state = work.state;
  options.termination.function_tolerance = 1e-12;
  const MinimizerSummary fine = run();
  EXPECT_LT(coarse.iterations.size(), fine.iterations.size());
  EXPECT_LT(fine.final_cost, coarse.final_cost);
}

}  // namespace
}  // namespace sfmcpp::optim::minimizer_test

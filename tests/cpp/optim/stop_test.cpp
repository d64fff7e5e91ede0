// A run that is stopped within a step that takes long.
#include <chrono>
#include <thread>

#include <gtest/gtest.h>

#include "sfmcpp/optim/minimizer.hpp"
#include "support/forwarding_model.hpp"
#include "support/linearized_problem.hpp"

namespace sfmcpp::optim::stop_test {
namespace {

using support::LinearizedProblem;

// What would take many times as long as any question to a listener.
class LongWork {
 public:
  void operator()(ThreadPool& pool) {
    pool.parallel_for(kTasks, [this](int) {
      ++done_;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    });
  }
  bool was_cut_short() const { return 0 < done_ && done_ < kTasks; }

 private:
  static constexpr int kTasks = 10000;
  std::atomic<int> done_ = 0;
};

// Takes long before it solves, in tasks or until it is told to stop.
class LongSolver final : public linear::LinearSolver {
 public:
  LongSolver(const linear::NormalEquations& normal, bool asks)
      : normal_(normal),
        asks_(asks),
        solver_(linear::make_linear_solver(normal, {linear::LinearSolverKind::kDense})) {}

  linear::LinearSolveResult solve(const linear::Damping& damping,
                                  linear::Step& step,
                                  const std::function<bool()>& should_stop) override {
    while (asks_ && !should_stop())
      normal_.pool().parallel_for(
          1, [](int) { std::this_thread::sleep_for(std::chrono::milliseconds(2)); });
    if (!asks_) work(normal_.pool());
    return solver_->solve(damping, step, should_stop);
  }

  LongWork work;

 private:
  const linear::NormalEquations& normal_;
  bool asks_;
  std::unique_ptr<linear::LinearSolver> solver_;
};

// Takes long to linearise once a step has been accepted.
class LongModel final : public support::ForwardingModel {
 public:
  using ForwardingModel::ForwardingModel;

  double linearize(const State& state) override {
    const double cost = ForwardingModel::linearize(state);
    if (++linearizations_ > 1) work(normal_equations().pool());
    return cost;
  }

  LongWork work;

 private:
  int linearizations_ = 0;
};

class Stop : public testing::TestWithParam<int> {  // threads
 protected:
  static support::SceneOptions start() {
    support::SceneOptions scene = support::perturbed(CameraModelId::kBal);
    scene.num_points = 30;
    return scene;
  }
  MinimizerSummary run(LeastSquaresModel& model, linear::LinearSolver& solver) {
    return minimize(model, solver, options, events, Stopwatch(), state);
  }
  void interrupt_when_polled() {
    events.poll = [] { return Signal::kInterrupt; };
  }

  LinearizedProblem work{support::make_circle_scene(start()), false, GetParam()};
  State state = work.state;
  MinimizerOptions options;
  Events events;
};

TEST_P(Stop, AnInterruptEndsALongLinearSolveAndLeavesTheState) {
  interrupt_when_polled();
  LongSolver solver(work.normal(), false);
  const MinimizerSummary summary = run(work.model, solver);
  EXPECT_TRUE(solver.work.was_cut_short());
  EXPECT_EQ(summary.termination, Termination::kInterrupted);
  EXPECT_EQ(summary.iterations.size(), 1u);
  EXPECT_EQ(summary.final_cost, summary.initial_cost);
  EXPECT_EQ(state.points, work.state.points);
}

TEST_P(Stop, ATimeLimitEndsALongLinearSolve) {
  options.termination.max_seconds = 0.5;
  LongSolver solver(work.normal(), false);
  const MinimizerSummary summary = run(work.model, solver);
  EXPECT_TRUE(solver.work.was_cut_short());
  EXPECT_EQ(summary.termination, Termination::kMaxSeconds);
  EXPECT_EQ(state.points, work.state.points);
}

TEST_P(Stop, TheStepOfASolverThatAsksIsTakenWhenTimeIsUp) {
  options.termination.max_seconds = 0.5;
  LongSolver solver(work.normal(), true);
  const MinimizerSummary summary = run(work.model, solver);
  EXPECT_EQ(summary.termination, Termination::kMaxSeconds);
  EXPECT_EQ(summary.iterations.size(), 2u);
  EXPECT_LT(summary.final_cost, summary.initial_cost);
}

TEST_P(Stop, AnInterruptAfterAnAcceptedStepKeepsIt) {
  interrupt_when_polled();
  LongModel model(work.model);
  const auto solver = linear::make_linear_solver(work.normal(), {linear::LinearSolverKind::kDense});
  const MinimizerSummary summary = run(model, *solver);
  EXPECT_TRUE(model.work.was_cut_short());
  EXPECT_EQ(summary.termination, Termination::kInterrupted);
  ASSERT_EQ(summary.iterations.size(), 2u);
  EXPECT_EQ(summary.iterations[1].cost, summary.final_cost);
  EXPECT_EQ(summary.final_cost, work.model.cost(state));
  EXPECT_LT(summary.final_cost, summary.initial_cost);
}

TEST_P(Stop, ARunThatMayGoOnEndsWhereItWasSaved) {
  interrupt_when_polled();
  std::optional<Resumption> last;
  events.on_resumable = [&](const std::function<Resumption()>& where, bool is_last) {
    if (is_last) last = where();
  };
  LongModel model(work.model);
  const auto solver = linear::make_linear_solver(work.normal(), {linear::LinearSolverKind::kDense});
  const MinimizerSummary summary = run(model, *solver);
  EXPECT_TRUE(model.work.was_cut_short());
  EXPECT_EQ(summary.iterations.size(), 1u);
  EXPECT_EQ(summary.final_cost, work.model.cost(state));
  ASSERT_TRUE(last);
  EXPECT_EQ(last->state.points, state.points);
  EXPECT_EQ(state.points, work.state.points);
}

INSTANTIATE_TEST_SUITE_P(Threads, Stop, testing::Values(1, 2));

}  // namespace
}  // namespace sfmcpp::optim::stop_test

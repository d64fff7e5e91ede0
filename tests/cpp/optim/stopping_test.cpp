// When a run has converged: a small decrease alone is not enough.
#include "../../../cpp/src/optim/stopping.hpp"

#include <gtest/gtest.h>

#include "sfmcpp/optim/minimizer.hpp"
#include "support/forwarding_model.hpp"
#include "support/linearized_problem.hpp"

namespace sfmcpp::optim::stopping_test {
namespace {

using support::LinearizedProblem;

TEST(Stopping, AStepKeepsItsPromiseWithAThousandthOfIt) {
  EXPECT_TRUE(kept_its_promise(1.01e-3, 1.0, 1e-6));
  EXPECT_FALSE(kept_its_promise(0.99e-3, 1.0, 1e-6));
  EXPECT_TRUE(kept_its_promise(0.0, 1e-6, 1e-6)) << "it promised next to nothing";
  EXPECT_FALSE(kept_its_promise(0.0, 1.01e-6, 1e-6));
}

TEST(Stopping, ADecreaseIsNegligibleByTheToleranceByRoundingOrByItself) {
  TerminationOptions termination;
  termination.function_tolerance = 1e-6;
  EXPECT_DOUBLE_EQ(negligible_decrease(termination, 2.0), 2e-6);
  termination.function_tolerance = 0.0;
  EXPECT_DOUBLE_EQ(negligible_decrease(termination, 2.0), 2e-9);
  EXPECT_DOUBLE_EQ(negligible_decrease(termination, 0.0), 1e-18);
}

class Convergence : public testing::Test {
 protected:
  static support::SceneOptions start() {
    support::SceneOptions scene = support::perturbed(CameraModelId::kBal);
    scene.num_points = 30;
    return scene;
  }
  Convergence() { options.method = Method::kLevenbergMarquardt; }

  MinimizerSummary run(LeastSquaresModel& model) {
    const auto solver =
        linear::make_linear_solver(work.normal(), {linear::LinearSolverKind::kDense});
    return minimize(model, *solver, options, {}, Stopwatch(), state);
  }
  bool is_stationary_at(const State& place) {
    const double cost = work.model.linearize(place);
    return gradient_is_small(options.termination, work.normal(), cost);
  }

  LinearizedProblem work{support::make_circle_scene(start())};
  State state = work.state;
  MinimizerOptions options;
};

TEST_F(Convergence, TheGradientIsSmallAtAMinimumAndWhereAllIsTolerated) {
  EXPECT_FALSE(is_stationary_at(work.state));
  run(work.model);
  EXPECT_TRUE(is_stationary_at(state));
  options.termination.function_tolerance = 1e3;
  EXPECT_TRUE(is_stationary_at(work.state));
}

// Steps that damping makes tiny keep their promises, of hardly anything, far from any minimum.
TEST_F(Convergence, StepsThatAreShortForTheirDampingAreNoEnd) {
  const double lowest = run(work.model).final_cost;
  state = work.state;
  options.initial_damping = 1e9;
  const MinimizerSummary damped = run(work.model);
  const double first = damped.initial_cost - damped.iterations[1].cost;
  ASSERT_LT(first, options.termination.function_tolerance * damped.initial_cost);
  EXPECT_EQ(damped.termination, Termination::kConverged);
  EXPECT_NEAR(damped.final_cost, lowest, 1e-4 * lowest);
}

// The first candidates seem to cost so many times what the start does.
class SeemingModel final : public support::ForwardingModel {
 public:
  SeemingModel(ba::BundleModel& model, double share, int candidates = 1)
      : ForwardingModel(model), share_(share), candidates_(candidates) {}

  double cost(const State& state) override {
    return ++costs_ <= candidates_ ? share_ * start_ : ForwardingModel::cost(state);
  }
  double linearize(const State& state) override {
    const double cost = ForwardingModel::linearize(state);
    if (costs_ == 0) start_ = cost;
    return cost;
  }

 private:
  double share_, start_ = 0.0;
  int candidates_;
  int costs_ = 0;
};

// Near a minimum, where unknowns promise little each alone, and much together.
TEST_F(Convergence, AStepThatBreaksItsPromiseIsNoEnd) {
  run(work.model);
  State near = state;
  double share = 1.0;
  do {
    share *= 0.5;
    for (std::size_t k = 0; k < near.points.size(); ++k)
      near.points[k] = state.points[k] + share * (work.state.points[k] - state.points[k]);
  } while (!is_stationary_at(near));
  state = near;
  SeemingModel model(work.model, 1.0 - 1e-8);
  const MinimizerSummary summary = run(model);
  ASSERT_TRUE(summary.iterations.at(1).accepted);
  ASSERT_LT(summary.initial_cost - summary.iterations[1].cost, 2e-8 * summary.initial_cost);
  EXPECT_GT(summary.iterations.size(), 2u);
  EXPECT_LT(summary.final_cost, summary.iterations[1].cost);
}

// Damping makes every step too short to change a digit.
TEST_F(Convergence, StepsThatChangeNothingFarFromAMinimumAreAFailure) {
  options.initial_damping = 1e60;
  SeemingModel model(work.model, 1.0, 1000);
  EXPECT_EQ(run(model).termination, Termination::kNumericalFailure);
}

// As by rounding, where damping makes the first step short.
TEST_F(Convergence, AStepThatIsRejectedForNextToNothingFarFromAMinimumIsNoEnd) {
  const double lowest = run(work.model).final_cost;
  state = work.state;
  options.initial_damping = 1e9;
  SeemingModel model(work.model, 1.0 + 1e-9);
  const MinimizerSummary summary = run(model);
  ASSERT_FALSE(summary.iterations.at(1).accepted);
  EXPECT_EQ(summary.termination, Termination::kConverged);
  EXPECT_NEAR(summary.final_cost, lowest, 1e-4 * lowest);
}

}  // namespace
}  // namespace sfmcpp::optim::stopping_test

// What holds of every method.
#include <limits>

#include <gtest/gtest.h>

#include "sfmcpp/linear/step_algebra.hpp"
#include "sfmcpp/optim/minimizer.hpp"
#include "support/dense_reference.hpp"
#include "support/enumerators.hpp"

namespace sfmcpp::optim::strategies_test {
namespace {

using support::LinearizedProblem;

class EveryMethod : public testing::TestWithParam<Method> {
 protected:
  MinimizerSummary run(Method method, int max_iterations) {
    MinimizerOptions options;
    options.method = method;
    options.termination.max_iterations = max_iterations;
    options.termination.function_tolerance = 1e-13;
    const auto solver =
        linear::make_linear_solver(work.normal(), {linear::LinearSolverKind::kDense});
    State state = work.state;
    const Stopwatch clock;
    return minimize(work.model, *solver, options, events, clock, state);
  }

  // Undamped steps need the gauge fixed; the minimum is the same.
  LinearizedProblem work{make_circle_scene(support::perturbed(CameraModelId::kCalibrated)),
                         GetParam() == Method::kGaussNewton};
  Events events;
};

TEST_P(EveryMethod, LowersTheCostWithEveryAcceptedStep) {
  const MinimizerSummary summary = run(GetParam(), 50);
  for (std::size_t k = 1; k < summary.iterations.size(); ++k) {
    const Iteration& now = summary.iterations[k];
    const double previous = summary.iterations[k - 1].cost;
    EXPECT_TRUE(now.accepted ? now.cost < previous : now.cost == previous) << "iteration " << k;
  }
  EXPECT_LT(summary.final_cost, 0.1 * summary.initial_cost);
}

TEST_P(EveryMethod, ReachesTheMinimumOfLevenbergMarquardt) {
  const double minimum = run(Method::kLevenbergMarquardt, 100).final_cost;
  // Gradient descent is close at once and then crawls.
  const MinimizerSummary summary =
      run(GetParam(), GetParam() == Method::kGradientDescent ? 5000 : 100);
  EXPECT_EQ(summary.termination, Termination::kConverged) << summary.message;
  EXPECT_NEAR(summary.final_cost / minimum, 1.0, 1e-9);
}

TEST_P(EveryMethod, PredictsWhatTheDenseModelFallsBy) {
  MinimizerOptions options;
  options.method = GetParam();
  const auto strategy = make_step_strategy(options);
  const auto solver = linear::make_linear_solver(work.normal(), {linear::LinearSolverKind::kDense});
  const support::DenseSystem dense = make_dense_system(work);
  linear::Step step;
  const StepResult result = strategy->compute(
      work.normal(), *solver, [] { return false; }, step);
  const double decrease = model_decrease(dense, flatten(dense, step));
  EXPECT_GT(decrease, 0.0);
  EXPECT_NEAR(result.predicted_decrease / decrease, 1.0, 1e-7);
}

TEST_P(EveryMethod, RejectionsShortenTheStepUntilNothingIsLeftToTry) {
  MinimizerOptions options;
  options.method = GetParam();
  const auto strategy = make_step_strategy(options);
  const auto solver = linear::make_linear_solver(work.normal(), {linear::LinearSolverKind::kDense});
  const linear::Step metric =
      linear::damping_entries(work.normal(), linear::DampingMatrix::kDiagonal);
  double previous = std::numeric_limits<double>::infinity();
  int rejections = 0;
  do {
    linear::Step step;
    const StepResult result = strategy->compute(
        work.normal(), *solver, [] { return false; }, step);
    ASSERT_TRUE(result.valid);
    EXPECT_GT(result.predicted_decrease, 0.0);
    const double length = norm(work.normal(), step, metric);
    EXPECT_LT(length, previous);
    previous = length;
    strategy->rejected();
  } while (strategy->can_retry() && ++rejections < 1000);
  EXPECT_EQ(rejections > 0, facts_of(GetParam()).shortens);
  EXPECT_LT(rejections, 100);
  if (facts_of(GetParam()).shortens) {
    EXPECT_LT(previous, 1e-9);
  }
}

INSTANTIATE_TEST_SUITE_P(Methods,
                         EveryMethod,
                         testing::ValuesIn(support::all_enumerators<Method>()),
                         [](const auto& test) { return support::identifier_of(test.param); });

}  // namespace
}  // namespace sfmcpp::optim::strategies_test

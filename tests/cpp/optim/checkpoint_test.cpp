// A method that was saved and restored goes on with the same bits.

#include <gtest/gtest.h>

#include "sfmcpp/linear/step_algebra.hpp"
#include "sfmcpp/optim/step_strategy.hpp"
#include "support/enumerators.hpp"
#include "support/random_system.hpp"

namespace sfmcpp::optim::checkpoint_test {
namespace {

constexpr int kSteps = 10;

MinimizerOptions options_of(Method method) {
  MinimizerOptions options;
  options.method = method;
  return options;
}

class SavedMethod : public testing::TestWithParam<Method> {
 protected:
  // All steps, with the strategy saved and restored into another before step `at`.
  std::vector<Eigen::VectorXd> run(int at) const {
    support::RandomSystem system({.cameras = 4, .points = 10});
    const auto solver =
        linear::make_linear_solver(system.normal(), {linear::LinearSolverKind::kDense});
    auto strategy = make_step_strategy(options_of(GetParam()));
    std::vector<Eigen::VectorXd> steps;
    for (int k = 0; k < kSteps; ++k) {
      if (k == at) {
        const std::vector<double> saved = save(*strategy);
        strategy = make_step_strategy(options_of(GetParam()));
        restore(saved, linear::negative_gradient(system.normal()), *strategy);
      }
      linear::Step step;
      strategy->compute(
          system.normal(), *solver, [] { return false; }, step);
      steps.push_back(flatten(system.dense(), step));
      if (k % 3 == 1) {
        strategy->rejected();
      } else {
        // Half of the way, so that there is always more to come.
        for (double& value : step.camera) value *= 0.5;
        for (double& value : step.point) value *= 0.5;
        system.move(step);
        strategy->accepted(k % 2 == 0 ? 0.9 : 0.2);
      }
    }
    return steps;
  }
};

TEST_P(SavedMethod, GoesOnWithTheSameBitsWhereverItWasSaved) {
  const std::vector<Eigen::VectorXd> uninterrupted = run(-1);
  for (int at = 0; at < kSteps; ++at) {
    const std::vector<Eigen::VectorXd> resumed = run(at);
    for (int k = 0; k < kSteps; ++k) {
      ASSERT_TRUE(uninterrupted[k].allFinite());
      EXPECT_EQ(resumed[k], uninterrupted[k]) << "saved before step " << at << ", step " << k;
    }
  }
}

TEST_P(SavedMethod, RefusesNumbersThatAreNotItsOwn) {
  const auto strategy = make_step_strategy(options_of(GetParam()));
  std::vector<double> saved = save(*strategy);
  saved.push_back(1.0);
  EXPECT_THROW(restore(saved, {}, *strategy), InvalidArgument);
  saved.pop_back();
  if (saved.empty()) return;
  saved.pop_back();
  EXPECT_THROW(restore(saved, {}, *strategy), InvalidArgument);
}

INSTANTIATE_TEST_SUITE_P(Methods,
                         SavedMethod,
                         testing::ValuesIn(support::all_enumerators<Method>()),
                         [](const auto& test) { return support::identifier_of(test.param); });

}  // namespace
}  // namespace sfmcpp::optim::checkpoint_test

#include "sfmcpp/optim/damping_rule.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "sfmcpp/optim/step_strategy.hpp"
#include "support/dense_reference.hpp"

namespace sfmcpp::optim::damping_rule_test {
namespace {

using linear::DampingMatrix;

TEST(HartleyRule, DividesByTenOnSuccessWhateverTheGain) {
  HartleyRule rule(1e-3, DampingMatrix::kDiagonal);
  EXPECT_EQ(rule.damping().lambda, 1e-3);
  rule.accepted(0.01);
  EXPECT_DOUBLE_EQ(rule.damping().lambda, 1e-4);
  rule.accepted(5.0);
  EXPECT_DOUBLE_EQ(rule.damping().lambda, 1e-5);
}

TEST(HartleyRule, MultipliesByTenOnFailure) {
  HartleyRule rule(1e-3, DampingMatrix::kIdentity);
  rule.rejected();
  rule.rejected();
  EXPECT_DOUBLE_EQ(rule.damping().lambda, 1e-1);
  EXPECT_EQ(rule.damping().matrix, DampingMatrix::kIdentity);
}

class Nielsen : public testing::Test {
 protected:
  Nielsen() { rule.start(normal.normal()); }
  double lambda() const { return rule.damping().lambda; }

  support::LinearizedProblem normal{support::make_circle_scene({})};
  NielsenRule rule{1e-3, DampingMatrix::kDiagonal};
};

TEST_F(Nielsen, SuccessScalesByTheCubicInTheGainButNotBelowAThird) {
  for (double gain : {0.1, 0.4, 0.5, 0.7, 0.9, 1.0, 3.0}) {
    const double before = lambda();
    rule.accepted(gain);
    const double factor = std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * gain - 1.0, 3));
    EXPECT_DOUBLE_EQ(lambda(), before * factor) << "gain " << gain;
  }
}

TEST_F(Nielsen, AGoodModelDividesByThreeAndAPoorOneGrows) {
  const double before = lambda();
  rule.accepted(1.0);
  EXPECT_DOUBLE_EQ(lambda(), before / 3.0);
  rule.accepted(0.5);
  EXPECT_DOUBLE_EQ(lambda(), before / 3.0);
  rule.accepted(0.0);
  EXPECT_DOUBLE_EQ(lambda(), before / 3.0 * 2.0);
}

TEST_F(Nielsen, FailuresMultiplyByTwoFourEightAndSoOn) {
  double expected = lambda();
  for (double growth : {2.0, 4.0, 8.0, 16.0}) {
    rule.rejected();
    expected *= growth;
    EXPECT_DOUBLE_EQ(lambda(), expected);
  }
}

TEST_F(Nielsen, ASuccessMakesTheNextFailureMultiplyByTwoAgain) {
  rule.rejected();
  rule.rejected();
  rule.accepted(0.5);
  const double before = lambda();
  rule.rejected();
  EXPECT_DOUBLE_EQ(lambda(), 2.0 * before);
}

TEST_F(Nielsen, StartsAtTauForTheDiagonalAndAtTauTimesTheLargestEntryForTheIdentity) {
  EXPECT_EQ(lambda(), 1e-3);
  NielsenRule identity(1e-3, DampingMatrix::kIdentity);
  identity.start(normal.normal());
  const auto dense = make_dense_system(normal);
  const double largest = dense.jacobian.colwise().squaredNorm().maxCoeff();
  EXPECT_NEAR(identity.damping().lambda / (1e-3 * largest), 1.0, 1e-12);
}

TEST(DampingRules, StayPositiveOverAnyRunOfSuccesses) {
  HartleyRule hartley(1e-3, DampingMatrix::kDiagonal);
  NielsenRule nielsen(1e-3, DampingMatrix::kDiagonal);
  for (int k = 0; k < 2000; ++k) {
    hartley.accepted(1.0);
    nielsen.accepted(1.0);
  }
  EXPECT_GT(hartley.damping().lambda, 0.0);
  EXPECT_GE(nielsen.damping().lambda, 0.0);
}

TEST(StepStrategy, OptionsChooseRuleStartAndMatrix) {
  MinimizerOptions options;
  options.method = Method::kLevenbergMarquardt;
  options.initial_damping = 0.5;
  const auto hartley = make_step_strategy(options);
  hartley->rejected();
  EXPECT_DOUBLE_EQ(hartley->damping(), 5.0);
  EXPECT_TRUE(hartley->can_retry());

  options.method = Method::kGaussNewton;
  const auto gauss_newton = make_step_strategy(options);
  EXPECT_EQ(gauss_newton->damping(), 0.0);
  EXPECT_FALSE(gauss_newton->can_retry());
}

TEST_F(Nielsen, StrategiesGiveUpRaisingTheDampingBeforeItOverflows) {
  const auto solver =
      linear::make_linear_solver(normal.normal(), {linear::LinearSolverKind::kDense});
  for (Method method : {Method::kLevenbergMarquardt, Method::kLevenbergMarquardtNielsen}) {
    MinimizerOptions options;
    options.method = method;
    const auto strategy = make_step_strategy(options);
    linear::Step step;
    strategy->compute(
        normal.normal(), *solver, [] { return false; }, step);
    int rejections = 0;
    while (strategy->can_retry() && rejections < 1000) {
      strategy->rejected();
      ++rejections;
    }
    EXPECT_LT(rejections, 100);
    EXPECT_TRUE(std::isfinite(strategy->damping()));
  }
}

}  // namespace
}  // namespace sfmcpp::optim::damping_rule_test

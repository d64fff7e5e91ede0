#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "sfmcpp/optim/line_search.hpp"
#include "support/fake_line.hpp"

namespace sfmcpp::optim::algebraic_search_test {
namespace {

using support::FakeLine;
using Asked = std::map<std::pair<double, double>, int>;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// ½ (x y − m)²: stationary at the lengths 0 and ±√m, for m > 0.
Biquadratic with_stationary_lengths(double m) { return {.pq = -m, .cc = 1.0}; }

// Stationary only at one pair: ½ (x − a)² + ½ (y − b)².
Biquadratic with_stationary_pair(double a, double b) {
  return {.aa = a * a + b * b, .ap = -a, .aq = -b, .pp = 1.0, .qq = 1.0};
}

LineSearchResult search_one_length(FakeLine& line) {
  return make_global_algebraic_search({})->search(line);
}

// Costs by the length proposed, around lengths −2, 0, 2 and the unit; slope −1 at the start.
class ThreeLengths : public testing::Test {
 protected:
  FakeLine line_with(double at_minus_two, double at_two, double at_one) const {
    FakeLine line(
        [=](double a) {
          if (a == -2.0) return at_minus_two;
          if (a == 2.0) return at_two;
          return a == 1.0 ? at_one : kStart;
        },
        [](double) { return -1.0; });
    line.algebraic = with_stationary_lengths(4.0);
    return line;
  }

  static constexpr double kStart = 10.0;
};

TEST_F(ThreeLengths, AllAreProposedWhicheverIsChosen) {
  FakeLine line = line_with(20.0, 20.0, 5.0);
  const LineSearchResult result = search_one_length(line);
  ASSERT_EQ(result.proposed.size(), 3U);
  for (int i = 0; i < 3; ++i) {
    EXPECT_DOUBLE_EQ(result.proposed[i].camera, 2.0 * (i - 1));
    EXPECT_EQ(result.proposed[i].camera, result.proposed[i].point);
  }
}

TEST_F(ThreeLengths, NoneBetterThanTheUnitStepGivesTheUnitStep) {
  FakeLine line = line_with(5.0, 6.0, 5.0);
  const StepLengths lengths = search_one_length(line).lengths;
  EXPECT_EQ(lengths.camera, 1.0);
  EXPECT_EQ(lengths.point, 1.0);
}

TEST_F(ThreeLengths, TheOnlyBetterOneIsTakenWithoutTheWolfeCondition) {
  FakeLine line = line_with(50.0, 11.0, 12.0);
  // At length zero the cost is that of the start, which is better than the unit step, too.
  line.algebraic = with_stationary_pair(2.0, 2.0);
  EXPECT_DOUBLE_EQ(search_one_length(line).lengths.camera, 2.0);
}

TEST_F(ThreeLengths, OfSeveralBetterOnesTheOneOfLeastCostIsTaken) {
  FakeLine line = line_with(6.0, 5.0, 8.0);
  EXPECT_DOUBLE_EQ(search_one_length(line).lengths.camera, 2.0);
  FakeLine other = line_with(4.0, 5.0, 8.0);
  EXPECT_DOUBLE_EQ(search_one_length(other).lengths.camera, -2.0);
}

// Equal costs: the tangent rises to the back, so that less is asked for in front.
TEST_F(ThreeLengths, TheDecreaseIsMeasuredFromTheTangent) {
  FakeLine line = line_with(5.0, 5.0, 8.0);
  EXPECT_DOUBLE_EQ(search_one_length(line).lengths.camera, -2.0);
}

TEST_F(ThreeLengths, SeveralBetterOnesOfWhichNoneDecreasesTheCostEnoughGiveTheUnitStep) {
  FakeLine line = line_with(11.0, kStart - 1e-4, 12.0);
  EXPECT_EQ(search_one_length(line).lengths.camera, 1.0);
}

TEST_F(ThreeLengths, CostsThatAreNotFiniteLose) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (double bad : {kInfinity, nan}) {
    FakeLine unit_is_bad = line_with(bad, 7.0, bad);
    EXPECT_DOUBLE_EQ(search_one_length(unit_is_bad).lengths.camera, 2.0);
    FakeLine roots_are_bad = line_with(bad, bad, 8.0);
    EXPECT_EQ(search_one_length(roots_are_bad).lengths.camera, 1.0);
    FakeLine all_are_bad = line_with(bad, bad, bad);
    all_are_bad.algebraic = with_stationary_pair(2.0, 2.0);
    EXPECT_EQ(search_one_length(all_are_bad).lengths.camera, 1.0);
  }
}

TEST_F(ThreeLengths, EachIsEvaluatedOnceAndTheUnitStepToo) {
  FakeLine line = line_with(6.0, 5.0, 8.0);
  const std::vector<StepLengths> proposed = search_one_length(line).proposed;
  Asked expected{{{1.0, 1.0}, 1}};
  for (const StepLengths& lengths : proposed) expected[{lengths.camera, lengths.point}] = 1;
  EXPECT_EQ(line.costs, expected);
}

TEST(AlgebraicSearch, WithoutAnAlgebraicCostTakesTheUnitStepAndEvaluatesNothing) {
  FakeLine line([](double a) { return a * a; }, [](double a) { return 2.0 * a; });
  const LineSearchResult result = search_one_length(line);
  EXPECT_EQ(result.lengths.camera, 1.0);
  EXPECT_TRUE(result.proposed.empty());
  EXPECT_TRUE(line.costs.empty());
}

TEST(AlgebraicSearch, EvaluatesTheUnitStepOnceIfItIsProposedWithOthers) {
  FakeLine line([](double, double) { return 0.0; });
  line.algebraic = with_stationary_lengths(1.0);
  EXPECT_EQ(search_one_length(line).proposed.size(), 3U);
  EXPECT_EQ(line.costs.size(), 3U);
  for (const auto& [lengths, times] : line.costs) EXPECT_EQ(times, 1);
}

TEST(AlgebraicSearch, DoesNotEvaluateAProposalOfTheUnitLength) {
  FakeLine line([](double, double) { return 0.0; });
  line.algebraic = with_stationary_pair(1.0 + 3e-7, 1.0 - 3e-7);
  for (const auto& search : {make_global_algebraic_search({}), make_two_way_algebraic_search({})}) {
    const LineSearchResult result = search->search(line);
    EXPECT_EQ(result.lengths.camera, 1.0);
    EXPECT_EQ(result.proposed.size(), 1U);
  }
  EXPECT_TRUE(line.costs.empty());
}

TEST(TwoWaySearch, TakesTwoLengthsWhereTheyAreBetterThanTheUnitStep) {
  FakeLine line([](double x, double y) { return std::abs(x - 0.4) + std::abs(y - 3.0); });
  line.algebraic = with_stationary_pair(0.5, 2.8);
  const LineSearchResult result = make_two_way_algebraic_search({})->search(line);
  ASSERT_EQ(result.proposed.size(), 1U);
  EXPECT_NEAR(result.lengths.camera, 0.5, 1e-14);
  EXPECT_NEAR(result.lengths.point, 2.8, 1e-14);
}

// A bilinear cost with two minima on either side: the better one by the true cost is taken.
TEST(TwoWaySearch, ChoosesAmongSeveralMinimaByTheTrueCost) {
  // ½ (x y − 4)² + ½ (x − y)²: minima at ±(2, 2), a saddle at the start.
  const Biquadratic algebraic{.aa = 16.0, .pp = 1.0, .qq = 1.0, .pq = -5.0, .cc = 1.0};
  for (double side : {-1.0, 1.0}) {
    FakeLine line(
        [&](double x, double y) { return algebraic.value(x, y) - 0.1 * side * (x + 2.0 * y); });
    line.algebraic = algebraic;
    const LineSearchResult result = make_two_way_algebraic_search({})->search(line);
    EXPECT_EQ(result.proposed.size(), 3U);
    EXPECT_NEAR(result.lengths.camera, 2.0 * side, 1e-12);
    EXPECT_NEAR(result.lengths.point, 2.0 * side, 1e-12);
  }
}

TEST(TwoWaySearch, TheWolfeConditionTakesEachLengthWithItsOwnSlope) {
  // Slopes 0 and −1e5 at the start, whose cost is 10; the unit step costs 30.
  const auto cost = [](double x, double y) {
    if (std::hypot(x, y) < 0.1) return 10.0 - 1e5 * y;
    if (y == 1.0) return 30.0;
    return x > 0.0 ? -20.0 : 29.0;
  };
  FakeLine line(cost);
  // ½ (x y − 4)² + ½ (4 x − y)²: minima at ±(1, 4), a saddle at the start.
  line.algebraic = Biquadratic{.aa = 16.0, .pp = 16.0, .qq = 1.0, .pq = -8.0, .cc = 1.0};
  // (1, 4) has to go below 10 − 1e-4 · 4e5 = −30, (−1, −4) below 50: only the second does.
  EXPECT_NEAR(make_two_way_algebraic_search({})->search(line).lengths.point, -4.0, 1e-12);
}

}  // namespace
}  // namespace sfmcpp::optim::algebraic_search_test

#include "sfmcpp/optim/line_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <set>
#include <vector>

#include <gtest/gtest.h>

#include "support/fake_line.hpp"
#include "support/line_functions.hpp"

namespace sfmcpp::optim::line_search_test {
namespace {

std::unique_ptr<LineSearch> make_backtracking(BacktrackingTest test) {
  LineSearchOptions options;
  options.backtracking_test = test;
  return make_backtracking_search(options);
}

using support::FakeLine;
using support::Function;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

class OnFunctions : public testing::TestWithParam<Function> {
 protected:
  double length_by(const LineSearch& search) {
    const StepLengths lengths = search.search(line).lengths;
    EXPECT_EQ(lengths.camera, lengths.point);
    return lengths.camera;
  }
  // λ(α) with a fraction of the slope at the start.
  double tangent(double length, double fraction) const {
    return line.cost_at_start() + fraction * length * line.start_slope();
  }
  double slope_fraction(double length) const { return line.slope_of(length) / line.start_slope(); }
  void expect_asked_once_and_at_most(std::size_t evaluations) const {
    EXPECT_LE(line.costs.size(), evaluations);
    for (const auto& [lengths, times] : line.costs) EXPECT_EQ(times, 1) << lengths.first;
    for (const auto& [length, times] : line.slopes) {
      EXPECT_EQ(times, 1) << length;
      EXPECT_GT(length, 0.0);
      EXPECT_TRUE(std::isfinite(line.cost_of(length))) << length;
    }
  }

  FakeLine line{GetParam().cost, GetParam().slope};
};

TEST_P(OnFunctions, SoftSearchMeetsItsTwoConditions) {
  const double a = length_by(*make_soft_search({}));
  EXPECT_LE(line.cost_of(a), tangent(a, 1e-3));
  EXPECT_LE(slope_fraction(a), 0.99);
  expect_asked_once_and_at_most(10);
}

TEST_P(OnFunctions, ExactSearchEndsWhereTheSlopeIsAThousandthOfThatAtTheStartOrNextToAMinimum) {
  const double a = length_by(*make_exact_search({}));
  EXPECT_LE(line.cost_of(a), tangent(a, 1e-3));
  const bool flat = std::abs(slope_fraction(a)) <= 1e-3;
  const bool narrow = line.slope_of(a - 1e-3) * line.slope_of(a + 1e-3) < 0.0;
  EXPECT_TRUE(flat || narrow) << "length " << a << " slope " << slope_fraction(a);
  expect_asked_once_and_at_most(10);
}

TEST_P(OnFunctions, ArmijoMeetsTheFirstWolfeCondition) {
  const double a = length_by(*make_backtracking(BacktrackingTest::kArmijo));
  EXPECT_LE(line.cost_of(a), tangent(a, 1e-4));
  EXPECT_LE(a, 1.0);
  EXPECT_TRUE(line.slopes.empty());
  expect_asked_once_and_at_most(20);
}

TEST_P(OnFunctions, StrongWolfeMeetsBothConditions) {
  const double a = length_by(*make_backtracking(BacktrackingTest::kStrongWolfe));
  EXPECT_LE(line.cost_of(a), tangent(a, 1e-4));
  EXPECT_LE(std::abs(slope_fraction(a)), 0.9);
  expect_asked_once_and_at_most(20);
}

// The slope of this function at its start is that of a point of inflection, nearly: the lengths
// between the two tangents are too few to be found (see TheBestLengthSeenIsTaken…).
bool has_hardly_a_slope(const Function& f) { return std::abs(f.slope(0.0)) < 1e-6; }

TEST_P(OnFunctions, GoldsteinIsBetweenItsTwoTangents) {
  if (has_hardly_a_slope(GetParam())) return;
  const double a = length_by(*make_backtracking(BacktrackingTest::kGoldstein));
  EXPECT_LE(line.cost_of(a), tangent(a, 0.25));
  EXPECT_GE(line.cost_of(a), tangent(a, 0.75));
  EXPECT_TRUE(line.slopes.empty());
  expect_asked_once_and_at_most(20);
}

TEST_P(OnFunctions, ExactAndSoftSearchAreNotWorseThanTheUnitStep) {
  EXPECT_LE(line.cost_of(length_by(*make_exact_search({}))), line.cost_of(1.0));
  EXPECT_LE(line.cost_of(length_by(*make_soft_search({}))), line.cost_of(1.0));
}

INSTANTIATE_TEST_SUITE_P(LineSearch,
                         OnFunctions,
                         testing::ValuesIn(support::kFunctions),
                         [](const auto& param) { return param.param.name; });

constexpr BacktrackingTest kTests[] = {
    BacktrackingTest::kArmijo, BacktrackingTest::kStrongWolfe, BacktrackingTest::kGoldstein};

std::vector<std::unique_ptr<LineSearch>> all_searches() {
  std::vector<std::unique_ptr<LineSearch>> searches;
  searches.push_back(make_exact_search({}));
  searches.push_back(make_soft_search({}));
  for (BacktrackingTest test : kTests) searches.push_back(make_backtracking(test));
  return searches;
}

double least_cost_asked(const FakeLine& line) {
  double least = kInfinity;
  for (const auto& [lengths, times] : line.costs)
    least = std::min(least, line.cost_of(lengths.first));
  return least;
}

TEST(Backtracking, TheBestLengthSeenIsTakenWhereNoneIsGoodInTwentyEvaluations) {
  FakeLine line(support::more_thuente_2, support::more_thuente_2_slope);
  const auto search = make_backtracking(BacktrackingTest::kGoldstein);
  const double a = search->search(line).lengths.camera;
  EXPECT_EQ(line.costs.size(), 20U);
  EXPECT_EQ(line.cost_of(a), least_cost_asked(line));
  EXPECT_LT(line.cost_of(a), -2.0);
}

// The first length is 1, and the minimum of the parabola through it is that of a quadratic.
TEST(Backtracking, FindsTheMinimumOfAQuadraticInTwoEvaluations) {
  FakeLine line(support::third, support::third_slope);
  const auto search = make_backtracking(BacktrackingTest::kArmijo);
  EXPECT_NEAR(search->search(line).lengths.camera, 1.0 / 3.0, 1e-15);
  EXPECT_EQ(line.costs.size(), 2U);
}

// (α − m)² decreases at α = 1 by 1 − 1/2m of what the tangent promises; its slope there is 1 − 1/m
// of that at the start.
bool keeps_unit_step(const LineSearch& search, double m) {
  FakeLine line([=](double a) { return (a - m) * (a - m); },
                [=](double a) { return 2.0 * (a - m); });
  const bool kept = search.search(line).lengths.camera == 1.0;
  EXPECT_EQ(kept, line.costs.size() == 1);
  return kept;
}

double with_decrease(double fraction) { return 0.5 / (1.0 - fraction); }
double with_slope(double fraction) { return 1.0 / (1.0 - fraction); }

TEST(Backtracking, KeepsTheUnitStepWithinTheLimitsOfItsTest) {
  const auto armijo = make_backtracking(BacktrackingTest::kArmijo);
  const auto wolfe = make_backtracking(BacktrackingTest::kStrongWolfe);
  const auto goldstein = make_backtracking(BacktrackingTest::kGoldstein);
  EXPECT_FALSE(keeps_unit_step(*armijo, with_decrease(0.9e-4)));
  EXPECT_TRUE(keeps_unit_step(*armijo, with_decrease(1.1e-4)));
  EXPECT_TRUE(keeps_unit_step(*armijo, with_decrease(0.99)));
  EXPECT_FALSE(keeps_unit_step(*wolfe, with_slope(-0.91)));
  EXPECT_TRUE(keeps_unit_step(*wolfe, with_slope(-0.89)));
  EXPECT_TRUE(keeps_unit_step(*wolfe, with_slope(0.89)));
  EXPECT_FALSE(keeps_unit_step(*wolfe, with_slope(0.91)));
  EXPECT_FALSE(keeps_unit_step(*goldstein, with_decrease(0.24)));
  EXPECT_TRUE(keeps_unit_step(*goldstein, with_decrease(0.26)));
  EXPECT_TRUE(keeps_unit_step(*goldstein, with_decrease(0.74)));
  EXPECT_FALSE(keeps_unit_step(*goldstein, with_decrease(0.76)));
}

TEST(ExactSearch, FindsTheMinimumOfAQuadraticWithinItsLongestLength) {
  FakeLine line(support::fourfold, support::fourfold_slope);
  EXPECT_NEAR(make_exact_search({})->search(line).lengths.camera, 4.0, 5e-3);
}

TEST(FrandsenSearch, GoesNoFurtherThanTenTimesTheStep) {
  FakeLine exact([](double a) { return -a; }, [](double) { return -1.0; });
  FakeLine soft = exact;
  EXPECT_EQ(make_exact_search({})->search(exact).lengths.camera, 10.0);
  EXPECT_EQ(make_soft_search({})->search(soft).lengths.camera, 10.0);
  EXPECT_EQ(exact.costs.size(), 5U);
  EXPECT_EQ(soft.costs.size(), 5U);
}

TEST(SoftSearch, KeepsTheUnitStepWithinTheLimitsOfItsConditions) {
  const auto soft = make_soft_search({});
  EXPECT_FALSE(keeps_unit_step(*soft, with_decrease(0.9e-3)));
  EXPECT_TRUE(keeps_unit_step(*soft, with_decrease(1.1e-3)));
  EXPECT_TRUE(keeps_unit_step(*soft, with_slope(0.98)));
  EXPECT_FALSE(keeps_unit_step(*soft, with_slope(0.995)));
}

TEST(SoftSearch, TakesTheUnitStepWhereTheLengthThatItFindsIsWorse) {
  FakeLine line([](double a) { return a < 1.5 ? -a : -0.5; },
                [](double a) { return a < 1.5 ? -1.0 : 0.0; });
  EXPECT_EQ(make_soft_search({})->search(line).lengths.camera, 1.0);
  EXPECT_EQ(line.costs.size(), 2U);
}

TEST(SoftSearch, GivesUpAfterTenEvaluations) {
  FakeLine line([](double a) { return 1.0 + a; }, [](double a) { return a > 0.0 ? 1.0 : -1.0; });
  make_soft_search({})->search(line);
  EXPECT_EQ(line.costs.size(), 10U);
}

TEST(AnySearch, OfAStepThatDoesNotDescendIsTheUnitStep) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const auto& search : all_searches())
    for (double slope : {0.0, 1.0, nan}) {
      FakeLine line([](double a) { return a; }, [=](double) { return slope; });
      EXPECT_EQ(search->search(line).lengths.camera, 1.0);
      EXPECT_TRUE(line.costs.empty());
    }
}

// A gradient that promises a descent where there is none: the step, not nothing, is rejected.
TEST(AnySearch, WhereNoLengthDecreasesTheCostTakesTheBestOfThoseLongerThanZero) {
  for (const auto& search : all_searches()) {
    FakeLine line([](double a) { return 1.0 + a; }, [](double a) { return a > 0.0 ? 1.0 : -1.0; });
    const double a = search->search(line).lengths.camera;
    EXPECT_GT(a, 0.0);
    EXPECT_EQ(line.cost_of(a), least_cost_asked(line));
    EXPECT_LE(line.costs.size(), 20U);
  }
}

TEST(AnySearch, CostsThatAreNotFiniteAreWorseThanAnyOther) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const auto& search : all_searches())
    for (double bad : {kInfinity, nan}) {
      const auto slope = [=](double a) { return a < 0.12 ? 2.0 * (a - 0.1) : nan; };
      FakeLine line([=](double a) { return a < 0.12 ? std::pow(a - 0.1, 2) : bad; }, slope);
      const double a = search->search(line).lengths.camera;
      EXPECT_LT(a, 0.12);
      EXPECT_LT(line.cost_of(a), line.cost_at_start());
      FakeLine hopeless([=](double b) { return b == 0.0 ? 1.0 : bad; },
                        [](double) { return -1.0; });
      EXPECT_EQ(search->search(hopeless).lengths.camera, 1.0);
      EXPECT_LE(hopeless.costs.size(), 20U);
      EXPECT_TRUE(hopeless.costs.contains({0.5, 0.5}));
    }
}

TEST(MakeLineSearch, NoneIsNull) { EXPECT_EQ(make_line_search({}), nullptr); }

// Where a search ends, and how many costs and slopes it asks for: another for each search.
using Outcome = std::array<double, 4>;

Outcome outcome_of(const LineSearch& search) {
  FakeLine line([](double a) { return (a - 20.0) * (a - 20.0); },
                [](double a) { return 2.0 * (a - 20.0); });
  line.algebraic = Biquadratic{.aa = 100.0, .ap = -6.0, .aq = -8.0, .pp = 1.0, .qq = 1.0};
  const StepLengths lengths = search.search(line).lengths;
  return {lengths.camera,
          lengths.point,
          static_cast<double>(line.costs.size()),
          static_cast<double>(line.slopes.size())};
}

TEST(MakeLineSearch, MakesTheSearchThatItsOptionsName) {
  std::vector<std::pair<LineSearchOptions, std::unique_ptr<LineSearch>>> cases;
  const auto add = [&](LineSearchKind kind, std::unique_ptr<LineSearch> expected) {
    cases.emplace_back(LineSearchOptions{}, std::move(expected));
    cases.back().first.kind = kind;
  };
  add(LineSearchKind::kGlobalAlgebraic, make_global_algebraic_search({}));
  add(LineSearchKind::kTwoWayAlgebraic, make_two_way_algebraic_search({}));
  add(LineSearchKind::kExact, make_exact_search({}));
  add(LineSearchKind::kSoft, make_soft_search({}));
  for (BacktrackingTest test : kTests) {
    add(LineSearchKind::kBacktracking, make_backtracking(test));
    cases.back().first.backtracking_test = test;
  }
  std::set<Outcome> outcomes;
  for (const auto& [options, expected] : cases) {
    EXPECT_EQ(outcome_of(*make_line_search(options)), outcome_of(*expected));
    outcomes.insert(outcome_of(*expected));
  }
  EXPECT_EQ(outcomes.size(), cases.size());
}

}  // namespace
}  // namespace sfmcpp::optim::line_search_test

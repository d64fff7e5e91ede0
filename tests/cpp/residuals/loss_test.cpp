#include "sfmcpp/residuals/loss.hpp"

#include <cmath>
#include <limits>
#include <memory>

#include <gtest/gtest.h>

#include "support/refusal.hpp"

namespace sfmcpp::loss_test {
namespace {

class EveryLoss : public testing::TestWithParam<LossKind> {
 protected:
  static constexpr double kScale = 1.7;
  Loss loss() const { return {GetParam(), kScale}; }
};

TEST_P(EveryLoss, IsTheSquareForSmallResiduals) {
  EXPECT_EQ(loss().rho(0.0), 0.0);
  EXPECT_EQ(loss().derivative(0.0), 1.0);
  EXPECT_NEAR(loss().rho(1e-6) / 1e-6, 1.0, 1e-6);
}

TEST_P(EveryLoss, DerivativeIsTheNumericOneAwayFromTheKnee) {
  constexpr double kKnee = kScale * kScale;
  for (double s = 0.05; s < 12.0; s += 0.1) {
    const double h = 1e-5;
    if (std::abs(s - kKnee) < 2 * h) continue;
    const double numeric = (loss().rho(s + h) - loss().rho(s - h)) / (2 * h);
    EXPECT_NEAR(loss().derivative(s), numeric, 1e-9) << "at s = " << s;
  }
}

TEST_P(EveryLoss, InfluenceSlopeIsTheNumericOneAwayFromTheKnee) {
  constexpr double kKnee = kScale * kScale;
  const auto influence = [&](double s) { return s * loss().derivative(s); };
  for (double s = 0.05; s < 12.0; s += 0.1) {
    const double h = 1e-5;
    if (std::abs(s - kKnee) < 2 * h) continue;
    const double numeric = (influence(s + h) - influence(s - h)) / (2 * h);
    EXPECT_NEAR(loss().influence_slope(s), numeric, 1e-9) << "at s = " << s;
  }
}

TEST_P(EveryLoss, NeverFallsAndBendsDown) {
  double before = loss().derivative(0.0);
  for (double s = 0.0; s < 50.0; s += 0.25) {
    EXPECT_GE(loss().rho(s + 0.25), loss().rho(s));
    EXPECT_GE(loss().derivative(s), 0.0);
    EXPECT_LE(loss().derivative(s), before) << "at s = " << s;
    before = loss().derivative(s);
  }
}

TEST_P(EveryLoss, ValueAndDerivativeAreContinuousAtTheKnee) {
  constexpr double kKnee = kScale * kScale;
  EXPECT_NEAR(loss().rho(kKnee * (1 - 1e-12)), loss().rho(kKnee * (1 + 1e-12)), 1e-10);
  EXPECT_NEAR(
      loss().derivative(kKnee * (1 - 1e-12)), loss().derivative(kKnee * (1 + 1e-12)), 1e-10);
}

// A loss that is constant far off would make a cost of a residual that there is not.
TEST_P(EveryLoss, OfNoNumberIsNoNumber) {
  EXPECT_TRUE(std::isnan(loss().rho(std::nan(""))));
  if (loss().is_squared()) return;
  EXPECT_TRUE(std::isnan(loss().derivative(std::nan(""))));
  EXPECT_TRUE(std::isnan(loss().influence_slope(std::nan(""))));
}

INSTANTIATE_TEST_SUITE_P(Kinds,
                         EveryLoss,
                         testing::Values(LossKind::kSquared,
                                         LossKind::kHuber,
                                         LossKind::kCauchy,
                                         LossKind::kTukey,
                                         LossKind::kGemanMcClure,
                                         LossKind::kTruncated));

TEST(Huber, GrowsLinearlyInTheResidualBeyondTheScale) {
  const Loss huber{LossKind::kHuber, 2.0};
  EXPECT_EQ(huber.rho(4.0), 4.0);
  EXPECT_DOUBLE_EQ(huber.rho(100.0), 2 * 2.0 * 10.0 - 4.0);
  EXPECT_DOUBLE_EQ(huber.derivative(100.0), 0.2);
}

TEST(Cauchy, GrowsWithTheLogarithm) {
  const Loss cauchy{LossKind::kCauchy, 2.0};
  EXPECT_DOUBLE_EQ(cauchy.rho(4.0), 4.0 * std::log(2.0));
  EXPECT_DOUBLE_EQ(cauchy.derivative(4.0), 0.5);
}

// docs/equations.md §4: c²/6 (1 − (1 − (x/c)²)³) is the cost of one residual: ½ ρ(x²).
TEST(Tukey, IsTheBiweightAndSaturatesAtTheScale) {
  const double c = 2.0;
  const Loss tukey{LossKind::kTukey, c};
  for (double x : {0.1, 0.8, 1.5, 1.99}) {
    const double biweight = c * c / 6 * (1 - std::pow(1 - x * x / (c * c), 3));
    EXPECT_NEAR(0.5 * tukey.rho(x * x), biweight, 1e-15);
  }
  EXPECT_DOUBLE_EQ(tukey.rho(4.0), c * c / 3);
  EXPECT_DOUBLE_EQ(tukey.rho(1e9), c * c / 3);
  EXPECT_EQ(tukey.derivative(4.0), 0.0);
  EXPECT_EQ(tukey.derivative(1e9), 0.0);
}

TEST(GemanMcClure, BendsToTheSquareOfTheScale) {
  const Loss loss{LossKind::kGemanMcClure, 2.0};
  EXPECT_DOUBLE_EQ(loss.rho(4.0), 2.0);
  EXPECT_DOUBLE_EQ(loss.derivative(4.0), 0.25);
  EXPECT_NEAR(loss.rho(1e12), 4.0, 1e-9);
}

TEST(Truncated, IsTheSquareUpToTheScaleAndConstantFromHalfAsMuchMoreOn) {
  const Loss loss{LossKind::kTruncated, 2.0};
  EXPECT_EQ(loss.rho(3.99), 3.99);
  EXPECT_EQ(loss.derivative(3.99), 1.0);
  EXPECT_NEAR(loss.rho(9.0 * (1 - 1e-14)), 1.5 * 4.0, 1e-12);
  EXPECT_EQ(loss.rho(1e12), 1.5 * 4.0);
  EXPECT_EQ(loss.derivative(9.0), 0.0);
}

// ρ′ = (1 − s)² up to s = 1.
std::vector<double> biweight() { return {1.0, -2.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0}; }

TEST(LossTable, IsTheIntegralOfItsPolynomials) {
  const Loss loss{.table =
                      std::make_shared<LossTable>("biweight", std::vector{0.0, 1.0}, biweight())};
  const Loss tukey{LossKind::kTukey};
  for (double s : {0.0, 0.3, 0.9, 1.0, 7.0}) {
    EXPECT_NEAR(loss.rho(s), tukey.rho(s), 1e-15);
    EXPECT_NEAR(loss.derivative(s), tukey.derivative(s), 1e-15);
  }
}

std::string refusal_of(std::vector<double> knots, std::vector<double> coefficients) {
  return support::message_of([&] { LossTable("mine", std::move(knots), std::move(coefficients)); });
}

TEST(LossTable, NumbersThatAreNotFiniteAndALossThatFallsAreRefused) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(refusal_of({0.0, 1.0}, std::vector(8, -1.0)),
            "coefficients: derivative -1.000000 at 0.000000: must not be negative");
  std::vector<double> falls = biweight();
  falls[0] = 0.9;
  EXPECT_EQ(refusal_of({0.0, 2.0}, falls),
            "coefficients: derivative -0.037500 at 1.500000: must not be negative");
  falls[3] = kNaN;
  EXPECT_EQ(refusal_of({0.0, 1.0}, falls), "coefficients[3]: must be finite");
  EXPECT_NE(refusal_of({0.0, HUGE_VAL}, biweight()), "no error");
}

// Polynomials through weights that fall to nothing within a cell, as those of exp(−s), swing.
TEST(LossTable, WeightsThatAreNothingBesideTheLargestMaySwingAboutZero) {
  std::vector<double> coefficients = {1.0, 0, 0, 0, 0, 0, 0, 0};
  coefficients.insert(coefficients.end(), {1e-20, -2.2e-20, 1.1e-20, 0, 0, 0, 0, 0});
  const LossTable loss("falls", {0.0, 1.0, 2.0}, coefficients);
  EXPECT_EQ(loss.derivative(2.0), 0.0);
  coefficients[9] = -2.2e-12;
  EXPECT_NE(refusal_of({0.0, 1.0, 2.0}, coefficients), "no error");
}

TEST(LossTable, GoesOnAsALineBeyondItsLastKnot) {
  const LossTable loss("line", {0.0, 1.0}, {0.8, -0.3, 0, 0, 0, 0, 0, 0});
  EXPECT_NEAR(loss.rho(1.0), 0.65, 1e-15);
  EXPECT_NEAR(loss.rho(5.0), 0.65 + 4.0 * 0.5, 1e-14);
  EXPECT_NEAR(loss.derivative(5.0), 0.5, 1e-15);
  EXPECT_NEAR(loss.influence_slope(0.5), 0.65 - 0.3 * 0.5, 1e-15);
  EXPECT_NEAR(loss.influence_slope(5.0), 0.5, 1e-15);
}

// 0.3 − 0.1 − 0.2 is less than zero, by rounding.
TEST(LossTable, DoesNotFallBeyondItsLastKnot) {
  const LossTable loss("falls", {0.0, 1.0}, {0.3, -0.1, -0.2, 0, 0, 0, 0, 0});
  EXPECT_EQ(loss.derivative(1e20), 0.0);
  EXPECT_EQ(loss.rho(1e20), loss.rho(1.0));
}

// The efficiency of an M-estimator of location, (E ψ′)² / E ψ² on standard normal numbers,
// integrated with ψ(x) = x ρ′(x²): 95 % is what defines the constants.
double efficiency(LossKind kind) {
  const Loss loss{kind, efficient_scale(kind, 1.0)};
  const auto psi = [&](double x) { return x * loss.derivative(x * x); };
  const double step = 1e-3;
  double slope = 0.0, square = 0.0;
  for (double x = -9.0; x < 9.0; x += step) {
    const double density = std::exp(-0.5 * x * x) / std::sqrt(2 * std::acos(-1.0)) * step;
    slope += (psi(x + 1e-6) - psi(x - 1e-6)) / 2e-6 * density;
    square += psi(x) * psi(x) * density;
  }
  return slope * slope / square;
}

TEST(EfficientScale, GivesNinetyFivePercentEfficiencyOnNormalResiduals) {
  EXPECT_NEAR(efficiency(LossKind::kHuber), 0.95, 5e-4);
  EXPECT_NEAR(efficiency(LossKind::kCauchy), 0.95, 5e-4);
  EXPECT_NEAR(efficiency(LossKind::kTukey), 0.95, 5e-4);
  EXPECT_NEAR(efficiency(LossKind::kGemanMcClure), 0.95, 5e-4);
  EXPECT_NEAR(efficiency(LossKind::kTruncated), 0.95, 5e-4);
  EXPECT_EQ(efficient_scale(LossKind::kAuto, 1.0), efficient_scale(LossKind::kTruncated, 1.0));
}

TEST(EfficientScale, IsProportionalToSigma) {
  for (LossKind kind :
       {LossKind::kSquared, LossKind::kHuber, LossKind::kCauchy, LossKind::kTukey}) {
    EXPECT_DOUBLE_EQ(efficient_scale(kind, 3.0), 3.0 * efficient_scale(kind, 1.0));
  }
  EXPECT_EQ(efficient_scale(LossKind::kSquared, 2.5), 2.5);
}

}  // namespace
}  // namespace sfmcpp::loss_test

#include "sfmcpp/math/polynomial.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

namespace sfmcpp::polynomial_test {
namespace {

using Coefficients = std::vector<double>;

Coefficients product(const Coefficients& a, const Coefficients& b) {
  Coefficients result(a.size() + b.size() - 1, 0.0);
  for (std::size_t i = 0; i < a.size(); ++i)
    for (std::size_t j = 0; j < b.size(); ++j) result[i + j] += a[i] * b[j];
  return result;
}

Coefficients with_roots(const std::vector<double>& roots) {
  Coefficients c{1.0};
  for (double root : roots) c = product(c, {-root, 1.0});
  return c;
}

// (x − re)² + im².
Coefficients conjugate_pair(double re, double im) { return {re * re + im * im, -2.0 * re, 1.0}; }

// How far relative changes of the coefficients by 2⁻⁵² can move a simple root.
double sensitivity(const Coefficients& c, double root) {
  double size = 0.0;
  double slope = 0.0;
  for (std::size_t k = 0; k < c.size(); ++k) {
    const auto power = static_cast<double>(k);
    size += std::abs(c[k]) * std::pow(std::abs(root), power);
    if (k > 0) slope += power * c[k] * std::pow(root, power - 1.0);
  }
  return std::numeric_limits<double>::epsilon() * size / std::abs(slope);
}

void expect_roots(const Coefficients& c, std::vector<double> expected) {
  std::ranges::sort(expected);
  const std::vector<double> roots = real_roots(c);
  ASSERT_EQ(roots.size(), expected.size());
  for (std::size_t i = 0; i < roots.size(); ++i)
    EXPECT_LE(std::abs(roots[i] - expected[i]), 10.0 * sensitivity(c, expected[i]))
        << "root " << expected[i];
}

// Real parts of the companion matrix' eigenvalues whose imaginary part is rounding; ascending.
std::vector<double> companion_roots(const Coefficients& c) {
  const auto n = static_cast<Eigen::Index>(c.size()) - 1;
  Eigen::MatrixXd companion = Eigen::MatrixXd::Zero(n, n);
  companion.diagonal(-1).setOnes();
  for (Eigen::Index k = 0; k < n; ++k)
    companion(k, n - 1) = -c[static_cast<std::size_t>(k)] / c.back();
  std::vector<double> roots;
  for (const auto& root : companion.eigenvalues())
    if (std::abs(root.imag()) < 1e-10 * std::abs(root)) roots.push_back(root.real());
  std::ranges::sort(roots);
  return roots;
}

std::vector<double> random_separated_roots(std::mt19937& random, std::size_t count) {
  std::uniform_real_distribution<double> uniform(-3.0, 3.0);
  std::vector<double> roots;
  while (roots.size() < count) {
    const double candidate = uniform(random);
    const auto is_near = [&](double root) { return std::abs(root - candidate) < 0.2; };
    if (std::ranges::none_of(roots, is_near)) roots.push_back(candidate);
  }
  return roots;
}

class ProductOfFactors : public testing::TestWithParam<std::size_t> {};

TEST_P(ProductOfFactors, HasTheRootsOfItsFactors) {
  std::mt19937 random(1);
  for (int run = 0; run < 200; ++run) {
    const std::vector<double> roots = random_separated_roots(random, GetParam());
    expect_roots(with_roots(roots), roots);
  }
}

TEST_P(ProductOfFactors, HasNoRootsForComplexPairs) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> re(-3.0, 3.0), im(0.2, 2.0);
  for (int run = 0; run < 200; ++run) {
    const std::vector<double> roots = random_separated_roots(random, GetParam());
    expect_roots(product(with_roots(roots), conjugate_pair(re(random), im(random))), roots);
  }
}

TEST_P(ProductOfFactors, KeepsItsRootsInEveryUnit) {
  std::mt19937 random(3);
  for (double unit : {1e-20, 1e-7, 1e7, 1e20}) {
    std::vector<double> roots = random_separated_roots(random, GetParam());
    for (double& root : roots) root *= unit;
    Coefficients c = with_roots(roots);
    for (double factor : {1e-100, 1e-20, 1e20, 1e100}) {
      Coefficients scaled = c;
      for (double& k : scaled) k *= factor;
      expect_roots(scaled, roots);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(NumberOfRoots, ProductOfFactors, testing::Values(1, 2, 3, 4, 5, 6));

TEST(RealRoots, AgreeWithTheEigenvaluesOfTheCompanionMatrix) {
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  for (int run = 0; run < 1000; ++run) {
    Coefficients c(run % 2 == 0 ? 4 : 6);
    for (double& k : c) k = normal(random);
    const std::vector<double> expected = companion_roots(c);
    const std::vector<double> roots = real_roots(c);
    ASSERT_EQ(roots.size(), expected.size()) << "run " << run;
    for (std::size_t i = 0; i < roots.size(); ++i)
      EXPECT_NEAR(roots[i], expected[i], 1e-9 * std::abs(expected[i])) << "run " << run;
  }
}

TEST(RealRoots, OfManyMagnitudesAreEachRightToRounding) {
  for (const auto& roots : {std::vector{1e-20, 1.0, 1e20},
                            std::vector{-1e18, -3e-5, 2e-12, 4e-12, 7e9},
                            std::vector{-1e-30, 1e30}}) {
    const std::vector<double> found = real_roots(with_roots(roots));
    ASSERT_EQ(found.size(), roots.size());
    for (std::size_t i = 0; i < roots.size(); ++i)
      EXPECT_NEAR(found[i], roots[i], 1e-14 * std::abs(roots[i]));
  }
}

TEST(RealRoots, OfCoefficientsOfVeryDifferentSizes) {
  const std::vector<double> roots = real_roots(Coefficients{1e-20, 1e20, 1e-20});
  ASSERT_EQ(roots.size(), 2U);
  EXPECT_DOUBLE_EQ(roots[0], -1e40);
  EXPECT_DOUBLE_EQ(roots[1], -1e-40);
}

TEST(RealRoots, InAClusterAreToldApartAsFarAsTheCoefficientsAllow) {
  expect_roots(with_roots({1.0, 1.001, 1.002}), {1.0, 1.001, 1.002});
  expect_roots(with_roots({0.5, 0.5 + 1e-6}), {0.5, 0.5 + 1e-6});
  expect_roots(with_roots({-2.0, 0.99, 1.0, 1.01, 7.0}), {-2.0, 0.99, 1.0, 1.01, 7.0});
}

struct Multiple {
  Coefficients coefficients;
  std::vector<double> roots;
};

class MultipleRoots : public testing::TestWithParam<Multiple> {};

TEST_P(MultipleRoots, AreReportedOnce) {
  const std::vector<double> roots = real_roots(GetParam().coefficients);
  ASSERT_EQ(roots.size(), GetParam().roots.size());
  for (std::size_t i = 0; i < roots.size(); ++i) EXPECT_NEAR(roots[i], GetParam().roots[i], 1e-7);
}

// Exact coefficients, and (tenths, thirds) such as rounding has changed.
INSTANTIATE_TEST_SUITE_P(
    Powers,
    MultipleRoots,
    testing::Values(Multiple{with_roots({1, 1}), {1}},
                    Multiple{with_roots({1, 1, -2}), {-2, 1}},
                    Multiple{with_roots({3, 3, 3}), {3}},
                    Multiple{with_roots({1, 1, 1, 1, 1}), {1}},
                    Multiple{with_roots({0.25, 0.25, 5, 5}), {0.25, 5}},
                    Multiple{with_roots({-7, -7, -7, 2, 2}), {-7, 2}},
                    Multiple{with_roots({0, 0, 0}), {0}},
                    Multiple{with_roots({-4, 0, 0, 6}), {-4, 0, 6}},
                    Multiple{product(with_roots({1, 1}), conjugate_pair(2, 1)), {1}},
                    Multiple{with_roots({0.1, 0.1}), {0.1}},
                    Multiple{with_roots({0.1, 0.1, 0.1}), {0.1}},
                    Multiple{with_roots({0.3, 0.3, 0.3, 0.3, 5.0}), {0.3, 5.0}},
                    Multiple{with_roots({0.3, 0.3, -0.7, -0.7}), {-0.7, 0.3}},
                    Multiple{with_roots({1 / 3.0, 1 / 3.0, 1 / 7.0}), {1 / 7.0, 1 / 3.0}},
                    Multiple{with_roots({1 / 7.0, 1 / 7.0, 2, 3, 4}), {1 / 7.0, 2, 3, 4}}));

// The derivative has three roots that can be told apart, but its integral is rounding at all three.
TEST(RealRoots, ThatRoundingCannotTellApartAreOne) {
  const std::vector<double> roots = real_roots(with_roots({1, 1, 1 + 5e-5, 1 + 5e-5}));
  ASSERT_EQ(roots.size(), 1U);
  EXPECT_NEAR(roots.front(), 1.0 + 2.5e-5, 2.6e-5);
}

TEST(RealRoots, OfAPolynomialWithoutAny) {
  EXPECT_TRUE(real_roots(Coefficients{1, 0, 1}).empty());
  EXPECT_TRUE(real_roots(Coefficients{1, 0, 1, 0, 1}).empty());
  EXPECT_TRUE(real_roots(Coefficients{1.0 + 1e-9, -2, 1}).empty());
  EXPECT_TRUE(real_roots(Coefficients{5}).empty());
  EXPECT_TRUE(real_roots(Coefficients{5, 0, 0}).empty());
}

TEST(RealRoots, OfZeroOrOfNumbersThatAreNotFiniteAreNone) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  EXPECT_TRUE(real_roots(Coefficients{}).empty());
  EXPECT_TRUE(real_roots(Coefficients{0, 0, 0, 0}).empty());
  EXPECT_TRUE(real_roots(Coefficients{-1, nan, 1}).empty());
  EXPECT_TRUE(real_roots(Coefficients{0, -1, infinity}).empty());
}

TEST(RealRoots, AreThoseOfTheOtherTermsWhereTheLeadingCoefficientIsNegligible) {
  EXPECT_EQ(real_roots(Coefficients{-6, 2, 0, 0}), std::vector{3.0});
  EXPECT_EQ(real_roots(Coefficients{-6, 2, 0, 1e-300}), std::vector{3.0});
  EXPECT_EQ(real_roots(Coefficients{-6, 2, 1e-70}), std::vector{3.0});
}

TEST(RealRoots, AreFoundAtTheEndsOfTheRangeOfDoubles) {
  EXPECT_EQ(real_roots(Coefficients{-6e307, 2e307}), std::vector{3.0});
  EXPECT_EQ(real_roots(Coefficients{-6e-310, 2e-310}).size(), 1U);
  EXPECT_NEAR(real_roots(Coefficients{-6e-310, 2e-310}).front(), 3.0, 1e-12);
}

}  // namespace
}  // namespace sfmcpp::polynomial_test

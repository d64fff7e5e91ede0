#include "sfmcpp/math/statistics.hpp"

#include <random>

#include <gtest/gtest.h>

namespace sfmcpp {
namespace {

std::vector<double> normal_sample(std::size_t count, double sigma, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0.0, sigma);
  std::vector<double> sample(count);
  for (double& value : sample) value = normal(random);
  return sample;
}

TEST(Median, IsTheMiddleOfAnOddCountAndTheMeanOfTheTwoMiddleOnesOfAnEvenCount) {
  EXPECT_EQ(median({5.0}), 5.0);
  EXPECT_EQ(median({9.0, -1.0, 4.0}), 4.0);
  EXPECT_EQ(median({9.0, 1.0, 4.0, 2.0}), 3.0);
  EXPECT_EQ(median({2.0, 2.0, 2.0, 7.0}), 2.0);
}

TEST(Median, DoesNotDependOnTheOrder) {
  std::vector<double> values = normal_sample(101, 1.0, 3);
  const double reference = median(values);
  std::mt19937 random(4);
  for (int repeat = 0; repeat < 10; ++repeat) {
    std::shuffle(values.begin(), values.end(), random);
    EXPECT_EQ(median(values), reference);
  }
}

// The standard error of the MAD of n normal numbers is about 1.17 σ/√n: 0.0083 σ here.
TEST(MadSigma, RecoversTheStandardDeviationOfNormalNumbers) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const double sigma = mad_sigma(normal_sample(20000, 2.5, seed));
    EXPECT_GT(sigma, 2.5 * 0.97);
    EXPECT_LT(sigma, 2.5 * 1.03);
  }
}

TEST(MadSigma, BarelyMovesWhenATenthOfTheNumbersAreGross) {
  std::vector<double> values = normal_sample(20000, 1.0, 6);
  for (std::size_t k = 0; k < values.size(); k += 10) values[k] = 1e6;
  // The median of |x| moves from the 50 % to the 55.6 % quantile: 0.764 / 0.6745 of it.
  EXPECT_NEAR(mad_sigma(values), 0.7645 * 1.4826, 0.03);
}

}  // namespace
}  // namespace sfmcpp

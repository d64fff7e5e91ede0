#include "sfmcpp/math/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include <gtest/gtest.h>

namespace sfmcpp::statistics_test {
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

// Distances of normal points of deviation sigma among others that are spread over a square.
std::vector<double> scatter(int inliers, double sigma, int outliers, double side, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0.0, sigma);
  std::uniform_real_distribution<double> uniform(-0.5 * side, 0.5 * side);
  std::vector<double> distances;
  for (int k = 0; k < inliers; ++k) distances.push_back(std::hypot(normal(random), normal(random)));
  for (int k = 0; k < outliers; ++k)
    distances.push_back(std::hypot(uniform(random), uniform(random)));
  return distances;
}

// 3000 inliers have their largest distance at 4 σ, where outliers are rare: one in 100 px² or less.
TEST(RadiusOfInliers, IsWhereTheyEndWhetherTheyAreMostOrFew) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    for (int outliers : {1000, 3000, 9000}) {
      for (double sigma : {0.5, 5.0}) {
        const double radius =
            radius_of_inliers(scatter(3000, sigma, outliers, 1000.0, seed), 1000.0 * 1000.0);
        EXPECT_GT(radius, 2.5 * sigma) << outliers << " outliers";
        EXPECT_LT(radius, 12.0 * sigma) << outliers << " outliers";
      }
    }
  }
}

TEST(RadiusOfInliers, IsTheLargestDistanceWhereThereAreNoOutliers) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const std::vector<double> distances = scatter(3000, 1.0, 0, 1.0, seed);
    EXPECT_EQ(radius_of_inliers(distances, 1e6), *std::ranges::max_element(distances));
  }
  EXPECT_EQ(radius_of_inliers({0.0, 0.0, 0.0}, 1e6), 0.0);
  EXPECT_EQ(radius_of_inliers({3.0}, 1e6), 3.0);
}

TEST(RadiusOfInliers, ExactOnesBesideNoisyOnesDoNotEndIt) {
  std::vector<double> distances(20, 0.0);
  for (int k = 0; k < 50; ++k) distances.push_back(0.5 + 0.01 * k);
  EXPECT_EQ(radius_of_inliers(distances, 1e6), distances.back());
}

TEST(RadiusOfInliers, AGapBeforeAFewIsChance) {
  std::vector<double> distances;
  for (int k = 1; k <= 100; ++k) distances.push_back(0.01 * k);
  for (int k = 0; k < 10; ++k) distances.push_back(3.0 + 0.01 * k);
  EXPECT_EQ(radius_of_inliers(distances, 1e9), distances.back());
}

TEST(RadiusOfInliers, DoesNotDependOnTheUnit) {
  std::vector<double> distances = scatter(1000, 1.0, 500, 800.0, 7);
  const double radius = radius_of_inliers(distances, 800.0 * 800.0);
  for (double& distance : distances) distance *= 1024.0;
  EXPECT_EQ(radius_of_inliers(distances, 1024.0 * 1024.0 * 800.0 * 800.0), 1024.0 * radius);
}

TEST(RadiusOfInliers, EndsForDistancesThatAreInfinite) {
  std::vector<double> distances(100, std::numeric_limits<double>::infinity());
  for (std::size_t k = 0; k < 60; ++k) distances[k] = 0.01 * double(k);
  EXPECT_LT(radius_of_inliers(distances, 1e6), 300.0);
}

}  // namespace
}  // namespace sfmcpp::statistics_test

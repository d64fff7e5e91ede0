// The kernels of every instruction set against brute force.
#include "sfmcpp/features/nearest.hpp"

#include <algorithm>
#include <functional>
#include <numeric>
#include <random>
#include <string>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>

#include "sfmcpp/core/error.hpp"
#include "support/instruction_sets.hpp"

namespace sfmcpp::features::nearest_test {
namespace {

struct Set {
  std::vector<std::uint8_t> elements;
  int dimension;

  int count() const { return static_cast<int>(elements.size()) / dimension; }
  Descriptors view() const { return {elements.data(), count(), dimension}; }
};

// Elements of `low` to `high`.
Set random_set(int seed, int count, int dimension, int low = 0, int high = 255) {
  std::mt19937 random(seed);
  Set set{{}, dimension};
  for (int k = 0; k < count * dimension; ++k)
    set.elements.push_back(static_cast<std::uint8_t>(low + random() % (high - low + 1)));
  return set;
}

int squared_distance(const Set& a, int i, const Set& b, int j) {
  const std::uint8_t* x = a.elements.data() + static_cast<long>(i) * a.dimension;
  const std::uint8_t* y = b.elements.data() + static_cast<long>(j) * b.dimension;
  return std::transform_reduce(
      x, x + a.dimension, y, 0, std::plus<>(), [](int p, int q) { return (p - q) * (p - q); });
}

Neighbours brute_force(const Set& a, const Set& b) {
  Neighbours result;
  for (int i = 0; i < a.count(); ++i) {
    int index = -1, best = kPadding, second = kPadding;
    for (int j = 0; j < b.count(); ++j) {
      const int distance = squared_distance(a, i, b, j);
      second = std::min(second, std::max(best, distance));
      if (distance < best) {
        best = distance;
        index = j;
      }
    }
    result.index.push_back(index);
    result.squared_distance.push_back(best);
    result.second_squared_distance.push_back(second);
  }
  return result;
}

void expect_equal(const Neighbours& found, const Neighbours& expected) {
  EXPECT_EQ(found.index, expected.index);
  EXPECT_EQ(found.squared_distance, expected.squared_distance);
  EXPECT_EQ(found.second_squared_distance, expected.second_squared_distance);
}

struct Case {
  std::string name;
  Set first, second;
};

std::vector<Case> cases() {
  std::vector<Case> all{
      {"many", random_set(1, 700, 128), random_set(2, 333, 128)},
      {"one of each", random_set(3, 1, 128), random_set(4, 1, 128)},
      {"two elements", random_set(5, 8, 2), random_set(6, 9, 2)},
      {"odd dimension", random_set(7, 65, 7), random_set(8, 67, 7)},
      {"largest dimension", random_set(9, 13, kMaxDimension), random_set(10, 17, kMaxDimension)},
      {"ties", random_set(11, 500, 3, 0, 2), random_set(12, 400, 3, 0, 2)},
      {"black and white", random_set(13, 5, 128, 0, 0), random_set(14, 7, 128, 255, 255)},
      {"white and white", random_set(13, 9, 128, 255, 255), random_set(14, 7, 128, 255, 255)},
      {"largest and black", Set{}, random_set(16, 4, kMaxDimension, 0, 0)},
      {"around the shift", random_set(17, 90, 128, 126, 130), random_set(18, 70, 128, 126, 130)}};
  all[8].first = random_set(15, 4, kMaxDimension, 255, 255);
  return all;
}

class Nearest : public testing::TestWithParam<std::tuple<int, bool>> {
 protected:
  void SetUp() override {
    const auto sets = support::instruction_sets();
    const auto number = static_cast<std::size_t>(std::get<0>(GetParam()));
    if (number >= sets.size()) GTEST_SKIP() << "this machine has no such instruction set";
    kernels_ = sets[number].nearest(std::get<1>(GetParam()));
  }

  NearestKernels kernels_{};
};

TEST_P(Nearest, AreThoseOfBruteForceForEveryNumberOfThreads) {
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const Neighbours of_first = brute_force(c.first, c.second);
    const Neighbours of_second = brute_force(c.second, c.first);
    for (int threads : {1, 3}) {
      ThreadPool pool(threads);
      expect_equal(nearest_of_first(c.first.view(), c.second.view(), pool, kernels_), of_first);
      const auto both = nearest_both_ways(c.first.view(), c.second.view(), pool, kernels_);
      expect_equal(both.of_first, of_first);
      expect_equal(both.of_second, of_second);
    }
  }
}

TEST_P(Nearest, OfNothingAreNone) {
  const Set some = random_set(1, 3, 128);
  const Descriptors nothing{nullptr, 0, 128};
  ThreadPool pool(2);
  const auto both = nearest_both_ways(some.view(), nothing, pool, kernels_);
  expect_equal(both.of_first, {{-1, -1, -1}, std::vector(3, kPadding), std::vector(3, kPadding)});
  EXPECT_TRUE(both.of_second.index.empty());
  expect_equal(nearest_both_ways(nothing, some.view(), pool, kernels_).of_second, both.of_first);
}

INSTANTIATE_TEST_SUITE_P(EveryInstructionSet,
                         Nearest,
                         testing::Combine(testing::Range(0, 3), testing::Bool()));

TEST(NearestOfSets, ThatDoNotGoTogetherAreRefused) {
  ThreadPool pool(1);
  const Set a = random_set(1, 3, 128), b = random_set(2, 3, 64), c = random_set(3, 1, 2049);
  EXPECT_THROW(nearest_both_ways(a.view(), b.view(), pool), InvalidArgument);
  EXPECT_THROW(nearest_of_first(c.view(), c.view(), pool), InvalidArgument);
  for (const Descriptors& broken : {Descriptors{nullptr, -1, 128}, Descriptors{nullptr, 0, -128}})
    EXPECT_THROW(nearest_of_first(broken, broken, pool), InvalidArgument);
}

}  // namespace
}  // namespace sfmcpp::features::nearest_test

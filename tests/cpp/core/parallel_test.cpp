#include "sfmcpp/core/parallel.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace sfmcpp {
namespace {

TEST(ThreadPool, RunsEveryTaskExactlyOnce) {
  for (int threads : {1, 2, 5}) {
    ThreadPool pool(threads);
    for (int repeat = 0; repeat < 200; ++repeat) {
      std::vector<std::atomic<int>> runs(137);
      pool.parallel_for(137, [&](int task) { ++runs[task]; });
      for (const auto& count : runs) ASSERT_EQ(count, 1);
    }
  }
}

TEST(ThreadPool, SumHasTheSameBitsForEveryNumberOfThreads) {
  const auto term = [](int task) { return std::sin(task * 1.7) * std::exp2(task % 40); };
  ThreadPool one(1);
  const double reference = one.sum(1000, term);
  for (int threads : {2, 3, 8}) {
    ThreadPool pool(threads);
    for (int repeat = 0; repeat < 50; ++repeat) ASSERT_EQ(pool.sum(1000, term), reference);
  }
}

TEST(ThreadPool, WorkersWakeAfterALongPause) {
  ThreadPool pool(2);
  pool.parallel_for(4, [](int) {});
  std::this_thread::sleep_for(std::chrono::milliseconds(30));
  std::atomic<int> count = 0;
  pool.parallel_for(100, [&](int) { ++count; });
  EXPECT_EQ(count, 100);
}

}  // namespace
}  // namespace sfmcpp

#include "sfmcpp/core/parallel.hpp"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

namespace sfmcpp::parallel_test {
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
  const double reference = one.sum(1000, term).value();
  for (int threads : {2, 3, 8}) {
    ThreadPool pool(threads);
    for (int repeat = 0; repeat < 50; ++repeat) ASSERT_EQ(pool.sum(1000, term).value(), reference);
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

TEST(ThreadPool, WorkersAreNumberedBelowTheNumberOfThreads) {
  ThreadPool pool(3);
  ASSERT_EQ(pool.num_threads(), 3);
  std::atomic<int> outside = 0;
  pool.parallel_for_worker(1000, [&](int, int worker) { outside += worker < 0 || worker >= 3; });
  EXPECT_EQ(outside, 0);
}

TEST(ThreadPool, TheFirstCallIsMadeOnceByTheCallingThreadBesideTheTasks) {
  for (int threads : {1, 2, 5}) {
    ThreadPool pool(threads);
    for (int count : {0, 1, 37}) {
      std::vector<std::atomic<int>> runs(count);
      int first = 0;
      std::thread::id where;
      pool.parallel_for_beside([&] { ++first, where = std::this_thread::get_id(); },
                               count,
                               [&](int task) { ++runs[task]; });
      EXPECT_EQ(first, 1);
      EXPECT_EQ(where, std::this_thread::get_id());
      for (const auto& run : runs) EXPECT_EQ(run, 1);
    }
  }
}

TEST(StopWatcher, EndsARegionBetweenItsTasks) {
  for (int threads : {1, 2, 5}) {
    ThreadPool pool(threads);
    std::atomic<int> done = 0;
    const auto task = [&](int) {
      ++done;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    };
    {
      StopWatcher watcher(pool, [] { return true; });
      EXPECT_THROW(pool.parallel_for(10000, task), Stopped);
      EXPECT_LT(done, 10000);
    }
    done = 0;
    pool.parallel_for(200, task);
    EXPECT_EQ(done, 200);
  }
}

// The thread that asks waits for the others here.
TEST(StopWatcher, EndsTasksThatHeedIt) {
  for (int threads : {1, 2, 5}) {
    ThreadPool pool(threads);
    const StopWatcher watcher(pool, [] { return true; });
    std::atomic<bool> other_began = threads == 1;
    EXPECT_THROW(pool.parallel_for_worker(2 * threads,
                                          [&](int, int worker) {
                                            other_began = other_began || worker != 0;
                                            while (worker != 0 || threads == 1 || !other_began)
                                              pool.heed_stop(worker);
                                          }),
                 Stopped);
  }
}

TEST(StopWatcher, LeavesWhatNobodyStopsAsItIs) {
  ThreadPool pool(2);
  int questions = 0;
  const StopWatcher watcher(pool, [&] { return ++questions < 0; });
  std::atomic<int> done = 0;
  pool.parallel_for(300, [&](int) {
    ++done;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  });
  EXPECT_EQ(done, 300);
  EXPECT_GT(questions, 0);
}

TEST(BorrowedPool, IsKeptForTheNextOneOfAsManyThreads) {
  const ThreadPool* before = nullptr;
  {
    const BorrowedPool pool(3);
    before = &*pool;
  }
  const BorrowedPool again(3);
  EXPECT_EQ(&*again, before);
  const BorrowedPool beside(3);
  EXPECT_NE(&*beside, before);
  EXPECT_EQ((*beside).num_threads(), 3);
}

TEST(BorrowedPool, HasAsManyThreadsAsAskedFor) {
  for (int threads : {2, 4, 1, 2}) EXPECT_EQ((*BorrowedPool(threads)).num_threads(), threads);
}

TEST(ThreadPool, NoTaskIsNoWork) {
  ThreadPool pool(2);
  EXPECT_EQ(pool.sum(0, [](int) { return 1.0; }).value(), 0.0);
}

TEST(ResolveNumThreads, ARequestIsKeptAndSmallWorkGetsOneThread) {
  EXPECT_EQ(resolve_num_threads(7, 1), 7);
  EXPECT_EQ(resolve_num_threads(0, 10), 1);
  const int all = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  EXPECT_EQ(resolve_num_threads(0, 1'000'000'000L), all);
}

}  // namespace
}  // namespace sfmcpp::parallel_test

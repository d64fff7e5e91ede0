// Threads that cannot be started, and tasks that throw.
#include <atomic>
#include <cmath>
#include <pthread.h>
#include <stdexcept>

#include <gtest/gtest.h>

#include "faults/failing_memory.hpp"
#include "sfmcpp/core/parallel.hpp"

namespace sfmcpp::faults::threads_test {
namespace {

// New threads want a larger stack than there is, and are refused by the system.
class NoThreads {
 public:
  NoThreads() {
    pthread_getattr_default_np(&before_);
    pthread_attr_t huge;
    pthread_attr_init(&huge);
    pthread_attr_setstacksize(&huge, std::size_t{1} << 50);
    pthread_setattr_default_np(&huge);
    pthread_attr_destroy(&huge);
  }
  ~NoThreads() {
    pthread_setattr_default_np(&before_);
    pthread_attr_destroy(&before_);
  }
  NoThreads(const NoThreads&) = delete;
  NoThreads& operator=(const NoThreads&) = delete;

 private:
  pthread_attr_t before_;
};

double sum(ThreadPool& pool) {
  return pool.sum(1000, [](int task) { return std::sin(1.7 * task); }).value();
}

double reference_sum() {
  ThreadPool one(1);
  return sum(one);
}

TEST(ThreadsThatCannotStart, LeaveTheWorkToTheCaller) {
  const NoThreads none;
  ThreadPool pool(4);
  EXPECT_EQ(pool.num_threads(), 1);
  EXPECT_EQ(sum(pool), reference_sum());
}

TEST(ThreadsThatCannotStart, AreDoneWithoutBesideThoseThatCould) {
  const double reference = reference_sum();
  bool some_were_missing = false;
  for (long number = 1;; ++number) {  // 0: the ranges of the pool
    const FailingMemory memory(number);
    ThreadPool pool(4);
    if (!memory.has_failed()) break;
    some_were_missing |= pool.num_threads() > 1 && pool.num_threads() < 4;
    ASSERT_EQ(sum(pool), reference);
  }
  EXPECT_TRUE(some_were_missing);
}

TEST(BorrowedPool, WithoutNewThreadsDoesNotSpoilTheNextOne) {
  {
    const NoThreads none;
    const BorrowedPool pool(5);
    EXPECT_EQ((*pool).num_threads(), 1);
  }
  const BorrowedPool pool(5);
  EXPECT_EQ((*pool).num_threads(), 5);
}

TEST(TaskThatThrows, IsHeardOfByTheCallerOnceNobodyWorks) {
  for (int threads : {1, 2, 5}) {
    ThreadPool pool(threads);
    for (int at = 0; at < 200; ++at) {
      std::atomic<int> at_work = 0;
      const auto task = [&](int k) {
        ++at_work;
        if (k == at) {
          --at_work;
          throw std::runtime_error("task " + std::to_string(k));
        }
        --at_work;
      };
      try {
        pool.parallel_for(200, task);
        FAIL() << "nothing was thrown";
      } catch (const std::runtime_error& error) {
        EXPECT_EQ(error.what(), "task " + std::to_string(at));
      }
      ASSERT_EQ(at_work, 0);
    }
    EXPECT_EQ(sum(pool), reference_sum());
  }
}

TEST(TaskThatThrows, BesideTheFirstCallToo) {
  ThreadPool pool(3);
  const auto fail = [] { throw std::runtime_error("first"); };
  EXPECT_THROW(pool.parallel_for_beside(fail, 20, [](int) {}), std::runtime_error);
  EXPECT_THROW(pool.parallel_for_beside([] {}, 20, [&](int) { fail(); }), std::runtime_error);
  EXPECT_EQ(sum(pool), reference_sum());
}

}  // namespace
}  // namespace sfmcpp::faults::threads_test

// Threads for one solve.
//
// The work is cut into tasks whose number and content do not depend on the number of threads, and
// each task writes only its own output; sums over tasks are taken in the order of the tasks. Hence
// the same bits for every number of threads.
//
// Workers spin for a moment before they sleep: a parallel region is entered dozens of times an
// iteration, and waking a sleeping thread costs as much as the work of a small region. A region
// never waits for a worker that has not come: on a busy machine the calling thread does the work
// alone.
#pragma once

#include <algorithm>
#include <atomic>
#include <exception>
#include <functional>
#include <memory>
#include <thread>
#include <vector>

#include "sfmcpp/core/compensated_sum.hpp"
#include "sfmcpp/core/stopwatch.hpp"

namespace sfmcpp {

class StopWatcher;

// For a loop that waits for another thread.
class SpinWait {
 public:
  // For a moment. Now and then it gives the processor away, and returns true.
  bool once();

 private:
  unsigned count_ = 0;
};

class ThreadPool {
 public:
  // `num_threads` counts the calling thread. They are fewer where the system has no more.
  explicit ThreadPool(int num_threads);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  int num_threads() const { return static_cast<int>(workers_.size()) + 1; }

  // Calls f(task) for every task in [0, count), in any order, on any thread. What one of them
  // throws ends the region: it is thrown again here once no thread is at work.
  template <class F>
  void parallel_for(int count, const F& f) {
    parallel_for_worker(count, [&f](int task, int) { f(task); });
  }

  // For tasks that take long: throws as a StopWatcher does between tasks.
  void heed_stop(int worker) const;

  // The same with f(task, worker), worker in [0, num_threads): a key for scratch memory.
  template <class F>
  void parallel_for_worker(int count, const F& f) {
    run(Job{&f, &call<F>, count});
  }

  // Calls first() on the calling thread, f(task) meanwhile on the others, and on the calling thread
  // once it is done.
  template <class First, class F>
  void parallel_for_beside(const First& first, int count, const F& f) {
    const auto task_of_f = [&f](int task, int) { f(task); };
    const auto task_of_first = [&first](int, int) { first(); };
    run(Job{&task_of_f,
            &call<decltype(task_of_f)>,
            count,
            &task_of_first,
            &call<decltype(task_of_first)>});
  }

  // Calls f(begin, end) for consecutive parts of [0, size), `part` long but for the last.
  template <class F>
  void parallel_for_parts(long size, long part, const F& f) {
    parallel_for(num_parts(size, part),
                 [&](int task) { f(task * part, std::min((task + 1) * part, size)); });
  }
  static int num_parts(long size, long part) { return static_cast<int>((size + part - 1) / part); }

  // Sum of f(task), a number or a sum, over the tasks, added in the order of the tasks.
  template <class F>
  CompensatedSum sum(int count, const F& f) {
    CompensatedSum total;
    for (const CompensatedSum& part : results(sums_, count, f)) total += part;
    return total;
  }
  // The same with f(begin, end) over consecutive parts of [0, size).
  template <class F>
  CompensatedSum sum_of_parts(long size, long part, const F& f) {
    return sum(num_parts(size, part),
               [&](int task) { return f(task * part, std::min((task + 1) * part, size)); });
  }
  // Largest f(task), and no less than zero; what is not a number is passed over.
  template <class F>
  double max(int count, const F& f) {
    double largest = 0.0;
    for (double value : results(numbers_, count, f)) largest = std::max(largest, value);
    return largest;
  }

 private:
  template <class T, class F>
  const std::vector<T>& results(std::vector<T>& values, int count, const F& f) {
    values.resize(static_cast<std::size_t>(count));
    parallel_for(count, [&](int task) { values[static_cast<std::size_t>(task)] = f(task); });
    return values;
  }

  struct Job {
    const void* function = nullptr;
    void (*call)(const void* function, int task, int worker) = nullptr;
    int count = 0;
    const void* first = nullptr;  // done by the calling thread before its tasks
    void (*call_first)(const void* function, int task, int worker) = nullptr;
  };
  template <class F>
  static void call(const void* function, int task, int worker) {
    (*static_cast<const F*>(function))(task, worker);
  }

  friend class StopWatcher;

  void run(const Job& job);
  void distribute();
  void work(int worker);
  void take_tasks(int worker);
  void give_up(std::exception_ptr failure);
  void wait_for_workers();
  void worker_main(int worker);
  unsigned wait_for_job(unsigned seen) const;

  // Each thread has a range of the tasks of its own, so that it meets the same data again in the
  // next region; who is done first takes from the ranges of the others.
  struct alignas(64) Range {
    std::atomic<int> next{0};
    int end = 0;
  };

  Job job_;
  std::vector<Range> ranges_;
  std::atomic<unsigned> generation_{0};
  std::atomic<bool> open_{false};  // may workers join the job?
  std::atomic<int> joined_{0};     // workers that look at the job now
  std::atomic<bool> failed_{false};
  std::exception_ptr failure_;  // of the job, if it has failed
  StopWatcher* watcher_ = nullptr;
  std::atomic<bool> stopping_{false};
  std::vector<double> numbers_;  // of the tasks of a region, as are the sums
  std::vector<CompensatedSum> sums_;
  std::vector<std::thread> workers_;
};

// What a region throws that was stopped.
struct Stopped {};

// While it lives, `is_wanted` is called a few times a second by the thread that enters the regions
// of the pool, between tasks; once it returns true, regions throw Stopped, and their outputs are
// incomplete.
class StopWatcher {
 public:
  StopWatcher(ThreadPool& pool, std::function<bool()> is_wanted);
  ~StopWatcher() { pool_.watcher_ = nullptr; }
  StopWatcher(const StopWatcher&) = delete;
  StopWatcher& operator=(const StopWatcher&) = delete;

  void look();

 private:
  ThreadPool& pool_;
  std::function<bool()> is_wanted_;
  Stopwatch since_last_;
};

// A pool for one call: an idle one of that many threads if there is, or else a new one; idle
// afterwards. To start a thread costs as much as a small part of a step.
class BorrowedPool {
 public:
  explicit BorrowedPool(int num_threads);
  ~BorrowedPool();
  BorrowedPool(const BorrowedPool&) = delete;
  BorrowedPool& operator=(const BorrowedPool&) = delete;

  ThreadPool& operator*() const { return *pool_; }

 private:
  std::unique_ptr<ThreadPool> pool_;
};

// Number of threads to use: `requested`, or for 0 the usable cores, unless the work is too small to
// gain from more than one.
int resolve_num_threads(int requested, long observations);

}  // namespace sfmcpp

// Where threads wait for one another. Not std::barrier: the thread sanitizer watches the core
// alone, and learns of tests only where they lock.
#pragma once

#include <condition_variable>
#include <mutex>

namespace sfmcpp::support {

class Barrier {
 public:
  explicit Barrier(int num_threads) : expected_(num_threads) {}

  void arrive_and_wait() {
    std::unique_lock lock(mutex_);
    const long mine = round_;
    if (++arrived_ == expected_) return open();
    opened_.wait(lock, [&] { return round_ != mine; });
  }
  // The others wait for this thread no more.
  void arrive_and_drop() {
    const std::scoped_lock lock(mutex_);
    --expected_;
    if (arrived_ == expected_) open();
  }

 private:
  void open() {
    arrived_ = 0;
    ++round_;
    opened_.notify_all();
  }

  std::mutex mutex_;
  std::condition_variable opened_;
  int expected_;
  int arrived_ = 0;
  long round_ = 0;
};

}  // namespace sfmcpp::support

#pragma once

#include <chrono>

namespace sfmcpp {

class Stopwatch {
 public:
  explicit Stopwatch(double seconds_before = 0.0) : seconds_before_(seconds_before) {}

  double seconds() const {
    return seconds_before_ +
           std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  double seconds_before_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

// Adds the time spent in a scope to a total.
class ScopedTimer {
 public:
  explicit ScopedTimer(double& total_seconds) : total_seconds_(total_seconds) {}
  ~ScopedTimer() { total_seconds_ += watch_.seconds(); }
  ScopedTimer(const ScopedTimer&) = delete;
  ScopedTimer& operator=(const ScopedTimer&) = delete;

 private:
  double& total_seconds_;
  Stopwatch watch_;
};

}  // namespace sfmcpp

#include "sfmcpp/core/parallel.hpp"

#include <algorithm>

namespace sfmcpp {
namespace {

constexpr int kSpins = 20000;
constexpr long kObservationsWorthAThread = 4000;

inline void relax() {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#endif
}

}  // namespace

ThreadPool::ThreadPool(int num_threads) {
  for (int worker = 1; worker < num_threads; ++worker) {
    workers_.emplace_back([this, worker] { worker_main(worker); });
  }
}

ThreadPool::~ThreadPool() {
  stopping_ = true;
  ++generation_;
  generation_.notify_all();
  for (std::thread& worker : workers_) worker.join();
}

void ThreadPool::run(const Job& job) {
  if (workers_.empty() || job.count <= 1) {
    for (int task = 0; task < job.count; ++task) job.call(job.function, task, 0);
    return;
  }
  job_ = job;
  next_task_ = 0;
  busy_workers_ = static_cast<int>(workers_.size());
  ++generation_;
  generation_.notify_all();
  work(0);
  while (busy_workers_.load(std::memory_order_acquire) > 0) relax();
}

void ThreadPool::work(int worker) {
  for (int task; (task = next_task_.fetch_add(1, std::memory_order_relaxed)) < job_.count;) {
    job_.call(job_.function, task, worker);
  }
}

void ThreadPool::worker_main(int worker) {
  unsigned seen = 0;
  while (true) {
    for (int spin = 0; spin < kSpins && generation_.load(std::memory_order_acquire) == seen; ++spin) {
      relax();
    }
    generation_.wait(seen);
    ++seen;
    if (stopping_) return;
    work(worker);
    busy_workers_.fetch_sub(1, std::memory_order_release);
  }
}

int resolve_num_threads(int requested, long observations) {
  if (requested > 0) return requested;
  const long worthwhile = std::max(1L, observations / kObservationsWorthAThread);
  const long available = std::max(1u, std::thread::hardware_concurrency());
  return static_cast<int>(std::min(worthwhile, available));
}

}  // namespace sfmcpp

#include "sfmcpp/core/parallel.hpp"

#include <algorithm>
#include <exception>
#include <memory>
#include <mutex>
#include <utility>

#if defined(__unix__) || defined(__APPLE__)
#include <unistd.h>
#endif

#include "sfmcpp/core/machine.hpp"

namespace sfmcpp {
namespace {

constexpr double kSpinSeconds = 2.5e-4;
constexpr double kSecondsBetweenQuestions = 0.2;  // of a StopWatcher
constexpr unsigned kSpinsBetweenLooks = 32;  // at the clock, or before giving the processor away
constexpr long kObservationsWorthAThread = 4000;

inline void relax() {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#endif
}

}  // namespace

bool SpinWait::once() {
  relax();
  if (++count_ % kSpinsBetweenLooks != 0) return false;
  std::this_thread::yield();
  return true;
}

ThreadPool::ThreadPool(int num_threads) : ranges_(std::max(num_threads, 1)) {
  try {
    for (int worker = 1; worker < num_threads; ++worker)
      workers_.emplace_back([this, worker] { worker_main(worker); });
  } catch (const std::exception&) {
    // The system has no more threads, or no memory for them: those there are do all the work.
  }
}

ThreadPool::~ThreadPool() {
  stopping_ = true;
  ++generation_;
  generation_.notify_all();
  for (std::thread& worker : workers_) worker.join();
}

void ThreadPool::run(const Job& job) {
  if (workers_.empty() || job.count + (job.first != nullptr) <= 1) {
    if (job.first != nullptr) job.call_first(job.first, 0, 0);
    for (int task = 0; task < job.count; ++task) {
      job.call(job.function, task, 0);
      heed_stop(0);
    }
    return;
  }
  // No worker is joined here: the last job was closed and left before it returned.
  job_ = job;
  distribute();
  open_ = true;
  ++generation_;
  generation_.notify_all();
  work(0);
  open_ = false;
  // A worker that reads `open_` after this line does not touch the job; one that read it before has
  // announced itself first.
  wait_for_workers();
  if (failed_.exchange(false)) std::rethrow_exception(std::exchange(failure_, nullptr));
}

void ThreadPool::wait_for_workers() {
  for (SpinWait wait; joined_ > 0;) {
    if (!wait.once()) continue;
    try {
      if (!failed_) heed_stop(0);
    } catch (...) {
      give_up(std::current_exception());
    }
  }
}

void ThreadPool::heed_stop(int worker) const {
  if (failed_) throw Stopped{};
  if (worker == 0 && watcher_ != nullptr) watcher_->look();
}

void ThreadPool::distribute() {
  const auto threads = static_cast<long>(ranges_.size());
  for (long k = 0; k < threads; ++k) {
    ranges_[k].next = static_cast<int>(k * job_.count / threads);
    ranges_[k].end = static_cast<int>((k + 1) * job_.count / threads);
  }
}

void ThreadPool::work(int worker) {
  try {
    if (worker == 0 && job_.first != nullptr) job_.call_first(job_.first, 0, 0);
    take_tasks(worker);
  } catch (...) {
    give_up(std::current_exception());
  }
}

void ThreadPool::take_tasks(int worker) {
  for (std::size_t k = 0; k < ranges_.size(); ++k) {
    Range& range = ranges_[(worker + k) % ranges_.size()];
    for (int task; (task = range.next.fetch_add(1, std::memory_order_relaxed)) < range.end;) {
      job_.call(job_.function, task, worker);
      heed_stop(worker);
    }
  }
}

// Keeps the first failure for the caller, and leaves the tasks that no thread has begun.
void ThreadPool::give_up(std::exception_ptr failure) {
  if (!failed_.exchange(true)) failure_ = std::move(failure);
  for (Range& range : ranges_) range.next = range.end;
}

// The number of the job that follows `seen`.
unsigned ThreadPool::wait_for_job(unsigned seen) const {
  const Stopwatch watch;
  unsigned generation;
  for (unsigned spin = 1; (generation = generation_) == seen; ++spin) {
    relax();
    if (spin % kSpinsBetweenLooks == 0 && watch.seconds() > kSpinSeconds) generation_.wait(seen);
  }
  return generation;
}

void ThreadPool::worker_main(int worker) {
  for (unsigned seen = 0; !stopping_;) {
    seen = wait_for_job(seen);
    ++joined_;
    if (open_) work(worker);
    --joined_;
  }
}

StopWatcher::StopWatcher(ThreadPool& pool, std::function<bool()> is_wanted)
    : pool_(pool), is_wanted_(std::move(is_wanted)) {
  pool.watcher_ = this;
}

void StopWatcher::look() {
  if (since_last_.seconds() < kSecondsBetweenQuestions) return;
  const bool is_wanted = is_wanted_();
  since_last_ = Stopwatch();
  if (is_wanted) throw Stopped{};
}

namespace {

// The pool that no call uses now, if there is one. It is never destroyed: its threads sleep until
// the process ends. The threads of a process stay behind where it is forked.
struct IdlePool {
  std::mutex mutex;
  std::unique_ptr<ThreadPool> pool;
  long process = 0;
};

IdlePool& idle() {
  static auto* one = new IdlePool;
  return *one;
}

long this_process_id() {
#if defined(__unix__) || defined(__APPLE__)
  return getpid();
#else
  return 0;
#endif
}

std::unique_ptr<ThreadPool> take_idle(int num_threads) {
  IdlePool& kept = idle();
  const std::unique_lock lock(kept.mutex, std::try_to_lock);
  if (!lock || !kept.pool) return nullptr;
  if (kept.process != this_process_id()) {
    static_cast<void>(kept.pool.release());
    return nullptr;
  }
  if (kept.pool->num_threads() != num_threads) return nullptr;
  return std::move(kept.pool);
}

}  // namespace

BorrowedPool::BorrowedPool(int num_threads) {
  if (num_threads > 1) pool_ = take_idle(num_threads);
  if (!pool_) pool_ = std::make_unique<ThreadPool>(num_threads);
}

BorrowedPool::~BorrowedPool() {
  if (pool_->num_threads() == 1) return;
  IdlePool& kept = idle();
  const std::unique_lock lock(kept.mutex, std::try_to_lock);
  if (!lock) return;
  std::swap(kept.pool, pool_);  // the one of before ends
  kept.process = this_process_id();
}

int resolve_num_threads(int requested, long observations) {
  if (requested > 0) return requested;
  const long worthwhile = std::max(1L, observations / kObservationsWorthAThread);
  if (worthwhile == 1) return 1;
  return static_cast<int>(std::min(worthwhile, static_cast<long>(usable_cores())));
}

}  // namespace sfmcpp

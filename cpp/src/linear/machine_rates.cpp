// What this machine does in a second, against the reference.
#include <algorithm>
#include <map>
#include <mutex>

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/core/stopwatch.hpp"
#include "sfmcpp/linear/dense_cholesky.hpp"
#include "sfmcpp/linear/solver_costs.hpp"

namespace sfmcpp::linear {
namespace {

constexpr int kRepeats = 3;
constexpr int kColumns = 480;
constexpr long kNumbers = 1 << 20;  // 8 MB, more than a core's own cache
constexpr long kPart = 1 << 14;

// Of the machine that the reference rates are of, as the measurements below have it.
constexpr double kReferenceFactorSeconds = 0.5e-3;
constexpr double kReferenceStreamSeconds = 0.16e-3;

// The shortest of a few, the first of which warms up.
template <class F>
double shortest_seconds(const F& f) {
  double shortest = 1e300;
  for (int k = 0; k < kRepeats; ++k) {
    const Stopwatch watch;
    f();
    shortest = std::min(shortest, watch.seconds());
  }
  return shortest;
}

double factor_seconds(ThreadPool& pool) {
  DenseCholesky cholesky(kColumns);
  return shortest_seconds([&] {
    cholesky.set_zero(pool);
    for (int k = 0; k < kColumns; ++k) cholesky.at(k, k) = 1.0;
    cholesky.factorize(pool);
  });
}

double stream_seconds(ThreadPool& pool) {
  AlignedVector<double> from(kNumbers), to(kNumbers);
  std::fill(from.begin(), from.end(), 1.0);
  return shortest_seconds([&] {
    pool.parallel_for_parts(kNumbers, kPart, [&](long begin, long end) {
      std::copy(from.begin() + begin, from.begin() + end, to.begin() + begin);
    });
  });
}

struct Speed {
  double flops = 1.0, bytes = 1.0;  // seconds over those of the reference
};

Speed measured(ThreadPool& pool) {
  return {.flops = factor_seconds(pool) / kReferenceFactorSeconds,
          .bytes = stream_seconds(pool) / kReferenceStreamSeconds};
}

Speed speed_of_this_machine(ThreadPool& pool) {
  static std::mutex mutex;
  static std::map<int, Speed> known;
  const std::scoped_lock lock(mutex);
  const auto [entry, is_new] = known.try_emplace(pool.num_threads());
  if (is_new) entry->second = measured(pool);
  return entry->second;
}

}  // namespace

Works rates_of_this_machine(ThreadPool& pool) {
  const Speed speed = speed_of_this_machine(pool);
  Works rates = reference_rates();
  for (const auto& row : EnumTraits<Work>::kTable)
    amount_of(rates, row.value) *= is_flops(row.value) ? speed.flops : speed.bytes;
  return rates;
}

}  // namespace sfmcpp::linear

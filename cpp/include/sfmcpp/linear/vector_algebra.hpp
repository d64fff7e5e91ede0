// Vectors in fixed parts on the threads of a pool. Products are compensated sums: conjugate
// gradients amplify what is rounded off, and the bits are to be the same however ranks divide the
// entries.
#pragma once

#include <vector>

#include <Eigen/Core>

#include "sfmcpp/core/parallel.hpp"

namespace sfmcpp::linear {

using Vector = std::vector<double>;

// Enough to be worth waking another thread for.
inline constexpr long kNumbersPerTask = 24576;

using VectorPart = Eigen::Map<Eigen::ArrayXd>;
using ConstVectorPart = Eigen::Map<const Eigen::ArrayXd>;

inline ConstVectorPart part(const Vector& x, long begin, long end) {
  return {x.data() + begin, end - begin};
}
inline VectorPart part(Vector& x, long begin, long end) { return {x.data() + begin, end - begin}; }

template <class F>
void for_each_part(ThreadPool& pool, const Vector& x, const F& f) {
  pool.parallel_for_parts(static_cast<long>(x.size()), kNumbersPerTask, f);
}

// Σ of the terms [begin, end), of which term<W>(k) gives W from k on.
template <class F>
CompensatedSum compensated_sum(long begin, long end, const F& term) {
  constexpr int kSums = 8;
  Pack<kSums> sums(0.0), rests(0.0);
  long k = begin;
  for (; k + kSums <= end; k += kSums)
    add_compensated(sums, rests, term.template operator()<kSums>(k));
  CompensatedSum total;
  for (; k < end; ++k) total += term.template operator()<1>(k)[0];
  for (int s = 0; s < kSums; ++s) total += CompensatedSum(sums[s], rests[s]);
  return total;
}

inline CompensatedSum dot(ThreadPool& pool, const Vector& a, const Vector& b) {
  const auto size = static_cast<long>(a.size());
  return pool.sum_of_parts(size, kNumbersPerTask, [&](long begin, long end) {
    return compensated_sum(
        begin, end, [&]<int W>(long k) { return load<W>(a.data() + k) * load<W>(b.data() + k); });
  });
}

inline CompensatedSum squared_norm(ThreadPool& pool, const Vector& x) { return dot(pool, x, x); }

// y ← y + s x
inline void add_scaled(ThreadPool& pool, double s, const Vector& x, Vector& y) {
  for_each_part(
      pool, y, [&](long begin, long end) { part(y, begin, end) += s * part(x, begin, end); });
}

// y ← x + s y
inline void scale_and_add(ThreadPool& pool, double s, const Vector& x, Vector& y) {
  for_each_part(pool, y, [&](long begin, long end) {
    part(y, begin, end) = part(x, begin, end) + s * part(y, begin, end);
  });
}

inline void scale(ThreadPool& pool, double s, Vector& x) {
  for_each_part(pool, x, [&](long begin, long end) { part(x, begin, end) *= s; });
}

}  // namespace sfmcpp::linear

// Vectors in fixed parts on the threads of a pool. A product is summed in the order of its terms
// within a part, and then in the order of the parts: its bits depend on nothing else.
#pragma once

#include <numeric>
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

inline double dot(ThreadPool& pool, const Vector& a, const Vector& b) {
  const auto size = static_cast<long>(a.size());
  return pool.sum_of_parts(size, kNumbersPerTask, [&](long begin, long end) {
    return std::inner_product(a.begin() + begin, a.begin() + end, b.begin() + begin, 0.0);
  });
}

inline double squared_norm(ThreadPool& pool, const Vector& x) { return dot(pool, x, x); }

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

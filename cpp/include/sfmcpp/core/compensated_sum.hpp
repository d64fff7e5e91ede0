// Sums in twice the working precision: what every addition rounds off is summed beside (Sum2 of
// Ogita, Rump & Oishi 2005, by Knuth's TwoSum).
//
// Rounded once, at the end, such a sum has the same bits for every order of its terms and for every
// way to divide them among threads and ranks, unless the exact sum lies within about 2⁻¹⁰⁰ of the
// terms of a number halfway between two doubles.
#pragma once

#include <algorithm>
#include <cmath>
#include <span>

#include "sfmcpp/core/simd.hpp"

namespace sfmcpp {

// sum + rest += x, for numbers and for packs of them.
template <class Real>
SFMCPP_INLINE void add_compensated(Real& sum, Real& rest, Real x) {
  const Real before = sum;
  sum = before + x;
  const Real added = sum - before;
  rest += (before - (sum - added)) + (x - added);
}

struct CompensatedSum {
  double sum = 0.0;
  double rest = 0.0;

  CompensatedSum() = default;
  CompensatedSum(double value, double rounded_off = 0.0)  // NOLINT: a number is a sum
      : sum(value), rest(rounded_off) {}

  CompensatedSum& operator+=(double x) {
    add_compensated(sum, rest, x);
    return *this;
  }
  CompensatedSum& operator+=(const CompensatedSum& other) {
    add_compensated(sum, rest, other.sum);
    rest += other.rest;
    return *this;
  }
  CompensatedSum operator-() const { return {-sum, -rest}; }

  // Of an overflow nothing is rounded off.
  double value() const { return std::isfinite(sum) ? sum + rest : sum; }
};

// Each rounded once, into as many numbers.
inline void round_sums(std::span<const CompensatedSum> sums, std::span<double> values) {
  std::ranges::transform(sums, values.begin(), &CompensatedSum::value);
}

}  // namespace sfmcpp

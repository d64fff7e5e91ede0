// A number with its first and second derivative along one direction. What is a template on its
// number type gives with it, in one pass, the second derivative of its result along a step.
#pragma once

#include "sfmcpp/core/simd.hpp"

namespace sfmcpp {

// f(x + α v + …) = value + α first + ½ α² second + O(α³).
template <class Real>
struct Jet {
  Real value, first, second;

  Jet() = default;
  SFMCPP_INLINE explicit Jet(double constant) : Jet(Real(constant), Real(0.0), Real(0.0)) {}
  SFMCPP_INLINE Jet(Real v, Real d, Real dd) : value(v), first(d), second(dd) {}

  SFMCPP_INLINE friend Jet operator+(const Jet& a, const Jet& b) {
    return Jet(a.value + b.value, a.first + b.first, a.second + b.second);
  }
  SFMCPP_INLINE friend Jet operator-(const Jet& a, const Jet& b) {
    return Jet(a.value - b.value, a.first - b.first, a.second - b.second);
  }
  SFMCPP_INLINE friend Jet operator*(const Jet& a, const Jet& b) {
    const Real cross = a.first * b.first;
    return Jet(a.value * b.value,
               a.value * b.first + a.first * b.value,
               a.value * b.second + a.second * b.value + cross + cross);
  }
  SFMCPP_INLINE friend Jet operator*(const Jet& a, double s) {
    return Jet(a.value * s, a.first * s, a.second * s);
  }
  SFMCPP_INLINE friend Jet operator+(const Jet& a, double s) {
    return Jet(a.value + s, a.first, a.second);
  }
};

// 1 / a, by one division.
template <class Real>
SFMCPP_INLINE Jet<Real> reciprocal(const Jet<Real>& a) {
  const Real value = Real(1.0) / a.value;
  const Real share = a.first * value;
  return Jet<Real>(value, -(share * value), (share * share * 2.0 - a.second * value) * value);
}

}  // namespace sfmcpp

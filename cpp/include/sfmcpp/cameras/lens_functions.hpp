// Functions of a lens beyond + − · / for every number type that a camera model meets: one number,
// packs of them, and jets along a step. For camera models of plug-ins (docs/how-to/own-camera.md).
#pragma once

#include "sfmcpp/core/simd.hpp"
#include "sfmcpp/math/jet.hpp"

namespace sfmcpp {

// F gives a function of one double and its first two derivatives: value(x), slope(x), bend(x), all
// SFMCPP_INLINE (core/isa.hpp).
template <class F>
SFMCPP_INLINE double value_of(double x) {
  return F::value(x);
}
template <class F>
SFMCPP_INLINE double slope_of(double x) {
  return F::slope(x);
}
template <class F>
SFMCPP_INLINE double bend_of(double x) {
  return F::bend(x);
}

template <class F, int kLanes>
SFMCPP_INLINE Pack<kLanes> value_of(const Pack<kLanes>& x) {
  Pack<kLanes> result;
  for (int lane = 0; lane < kLanes; ++lane) result.v[lane] = F::value(x.v[lane]);
  return result;
}
template <class F, int kLanes>
SFMCPP_INLINE Pack<kLanes> slope_of(const Pack<kLanes>& x) {
  Pack<kLanes> result;
  for (int lane = 0; lane < kLanes; ++lane) result.v[lane] = F::slope(x.v[lane]);
  return result;
}
template <class F, int kLanes>
SFMCPP_INLINE Pack<kLanes> bend_of(const Pack<kLanes>& x) {
  Pack<kLanes> result;
  for (int lane = 0; lane < kLanes; ++lane) result.v[lane] = F::bend(x.v[lane]);
  return result;
}

template <class F, class Real>
SFMCPP_INLINE Jet<Real> value_of(const Jet<Real>& x) {
  const Real slope = slope_of<F>(x.value);
  return Jet<Real>(value_of<F>(x.value),
                   slope * x.first,
                   slope * x.second + bend_of<F>(x.value) * (x.first * x.first));
}

}  // namespace sfmcpp

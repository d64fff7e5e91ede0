// A camera whose calibration is known: f, aspect, cx, cy, skew, none of them ever free.
#pragma once

#include <array>
#include <string_view>

#include "sfmcpp/cameras/camera_concept.hpp"

namespace sfmcpp {

// u = f x + skew y + cx, v = aspect f y + cy. Reads five numbers and has no derivative by them.
struct CalibratedLens {
  static constexpr std::array<std::string_view, 5> kNames{"f", "aspect", "cx", "cy", "skew"};
  static constexpr int kIntrinsics = 0;
  static constexpr bool kDistorts = false;

  SFMCPP_INLINE static Pinhole pinhole(const double* k) {
    return {k[0], k[4], k[2], k[0] * k[1], k[3]};
  }
  SFMCPP_INLINE static Pinhole pinhole_change(const double*, const double*) { return {}; }

  template <class Parameter, class Real>
  static void distort(const Parameter* k, Real x, Real y, Real& u, Real& v) {
    u = x * k[0] + y * k[4] + k[2];
    v = y * (k[0] * k[1]) + k[3];
  }

  template <class Parameter, class Real>
  static void linearize(const Parameter* k, Real x, Real y, LinearizedLens<Real, 0>& out) {
    distort(k, x, y, out.u, out.v);
    out.plane[0][0] = Real(k[0]);
    out.plane[0][1] = Real(k[4]);
    out.plane[1][0] = Real(0.0);
    out.plane[1][1] = Real(k[0] * k[1]);
  }
};

using CalibratedCamera = MetricCamera<CalibratedLens>;

}  // namespace sfmcpp

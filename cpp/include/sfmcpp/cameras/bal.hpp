// The camera of the BAL data sets and of Bundler: f, k1, k2; square pixels, principal point at the
// origin. Files look along −z with y up; io turns them to z forward, y down once.
#pragma once

#include <array>
#include <string_view>

#include "sfmcpp/cameras/camera_concept.hpp"

namespace sfmcpp {

// (u, v) = f (1 + k1 r² + k2 r⁴) (x, y).
struct BalLens {
  static constexpr std::array<std::string_view, 3> kNames{"f", "k1", "k2"};
  static constexpr int kIntrinsics = 3;
  static constexpr bool kDistorts = true;

  SFMCPP_INLINE static Pinhole pinhole(const double* k) { return {k[0], 0.0, 0.0, k[0], 0.0}; }
  SFMCPP_INLINE static Pinhole pinhole_change(const double*, const double* dk) {
    return {dk[0], 0.0, 0.0, dk[0], 0.0};
  }

  template <class Parameter, class Real>
  static void distort(const Parameter* intrinsics, Real x, Real y, Real& u, Real& v) {
    const Real r2 = x * x + y * y;
    const Real scale =
        (Real(1.0) + r2 * (Real(intrinsics[1]) + r2 * intrinsics[2])) * intrinsics[0];
    u = scale * x;
    v = scale * y;
  }

  template <class Parameter, class Real>
  static void linearize(const Parameter* intrinsics, Real x, Real y, LinearizedLens<Real, 3>& out) {
    const Parameter f = intrinsics[0], k1 = intrinsics[1], k2 = intrinsics[2];
    const Real r2 = x * x + y * y;
    const Real distortion = Real(1.0) + r2 * (Real(k1) + r2 * k2);
    const Real slope = (Real(k1) + r2 * (2.0 * k2)) * (2.0 * f);  // f · d(distortion)/d(r²) · 2
    const Real scale = distortion * f;
    out.u = scale * x;
    out.v = scale * y;
    out.plane[0][0] = scale + slope * x * x;
    out.plane[0][1] = out.plane[1][0] = slope * x * y;
    out.plane[1][1] = scale + slope * y * y;
    const Real by_k1 = r2 * f, by_k2 = by_k1 * r2;
    out.intrinsics[0][0] = distortion * x;
    out.intrinsics[1][0] = distortion * y;
    out.intrinsics[0][1] = by_k1 * x;
    out.intrinsics[1][1] = by_k1 * y;
    out.intrinsics[0][2] = by_k2 * x;
    out.intrinsics[1][2] = by_k2 * y;
  }
};

using BalCamera = MetricCamera<BalLens>;

}  // namespace sfmcpp

// The division model (Fitzgibbon 2001), which is not linear in its l: a plug-in for tests.
#pragma once

#include <array>
#include <string_view>

#include "sfmcpp/cameras/camera_concept.hpp"
#include "sfmcpp/cameras/lens_functions.hpp"

namespace sfmcpp {

struct InverseOfOnePlus {
  SFMCPP_INLINE static double value(double s) { return 1 / (1 + s); }
  SFMCPP_INLINE static double slope(double s) { return -value(s) * value(s); }
  SFMCPP_INLINE static double bend(double s) { return 2 * value(s) * value(s) * value(s); }
};

struct DivisionLens {
  static constexpr std::array<std::string_view, 4> kNames{"f", "cx", "cy", "l"};
  static constexpr int kIntrinsics = 4;
  static constexpr bool kDistorts = true;

  SFMCPP_INLINE static Pinhole pinhole(const double* k) { return {k[0], 0.0, k[1], k[0], k[2]}; }
  SFMCPP_INLINE static Pinhole pinhole_change(const double*, const double* dk) {
    return {dk[0], 0.0, dk[1], dk[0], dk[2]};
  }

  template <class Parameter, class Real>
  static void distort(const Parameter* k, Real x, Real y, Real& u, Real& v) {
    const Real scale = value_of<InverseOfOnePlus>((x * x + y * y) * k[3]);
    u = scale * x * k[0] + k[1];
    v = scale * y * k[0] + k[2];
  }

  template <class Parameter, class Real>
  static void linearize(const Parameter* k, Real x, Real y, LinearizedLens<Real, 4>& out) {
    const Real q = x * x + y * y, zero(0.0), one(1.0);
    const Real scale = value_of<InverseOfOnePlus>(q * k[3]);
    const Real by_q = slope_of<InverseOfOnePlus>(q * k[3]) * k[3];
    const Real by_l = slope_of<InverseOfOnePlus>(q * k[3]) * q;
    out.u = scale * x * k[0] + k[1];
    out.v = scale * y * k[0] + k[2];
    out.plane[0][0] = (scale + by_q * x * x * 2.0) * k[0];
    out.plane[0][1] = out.plane[1][0] = by_q * x * y * 2.0 * k[0];
    out.plane[1][1] = (scale + by_q * y * y * 2.0) * k[0];
    set(out, 0, scale * x, scale * y);
    set(out, 1, one, zero);
    set(out, 2, zero, one);
    set(out, 3, by_l * x * k[0], by_l * y * k[0]);
  }

 private:
  template <class Real>
  static void set(LinearizedLens<Real, 4>& out, int column, Real u, Real v) {
    out.intrinsics[0][column] = u;
    out.intrinsics[1][column] = v;
  }
};

struct PluginCamera : MetricCamera<DivisionLens> {
  static constexpr std::array<double, 4> kExample{420, 300, 250, 0.3};
};

}  // namespace sfmcpp

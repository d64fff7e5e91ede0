// The fisheye camera of OpenCV (Kannala & Brandt 2006): a point at the angle θ to the axis is seen
// at the radius θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) beside the focal length.
//
// A lens takes (x, y) at depth one to pixels. With q = x² + y² and h(q) = atan(√q) / √q the scale
// of (x, y) is h (1 + k1 t + …), t = θ² = h² q: smooth in q, on the axis too.
#pragma once

#include <array>
#include <cmath>
#include <string_view>

#include "sfmcpp/cameras/camera_concept.hpp"
#include "sfmcpp/cameras/lens_functions.hpp"

namespace sfmcpp {

// h and its derivatives by q; near the axis by the series Σ (−q)ⁿ / (2n + 1). What is compiled for
// several instruction sets is inlined everywhere (core/isa.hpp).
struct AngleRatio {
  static constexpr double kNear = 0.01;

  SFMCPP_INLINE static double value(double q) {
    if (q > kNear) return std::atan(std::sqrt(q)) / std::sqrt(q);
    return 1 - q * (1. / 3 - q * (1. / 5 - q * (1. / 7 - q * (1. / 9 - q * (1. / 11 - q / 13)))));
  }
  SFMCPP_INLINE static double slope(double q) {
    if (q > kNear) return (1 / (1 + q) - value(q)) / (2 * q);
    return -1. / 3 +
           q * (2. / 5 - q * (3. / 7 - q * (4. / 9 - q * (5. / 11 - q * (6. / 13 - q * 7 / 15)))));
  }
  SFMCPP_INLINE static double bend(double q) {
    if (q > kNear) return -(1 / ((1 + q) * (1 + q)) + 3 * slope(q)) / (2 * q);
    return 2. / 5 - q * (6. / 7 - q * (12. / 9 - q * (20. / 11 - q * (30. / 13 - q * 42 / 15))));
  }
};

struct FisheyeLens {
  static constexpr std::array<std::string_view, 8> kNames{
      "fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"};
  static constexpr int kIntrinsics = 8;
  static constexpr bool kDistorts = true;
  enum Parameter { kFx, kFy, kCx, kCy, kK1 };
  static constexpr int kTerms = 4;

  // The camera without the lens, and what a step of the intrinsics changes of it.
  SFMCPP_INLINE static Pinhole pinhole(const double* k) {
    return {k[kFx], 0.0, k[kCx], k[kFy], k[kCy]};
  }
  SFMCPP_INLINE static Pinhole pinhole_change(const double*, const double* dk) {
    return {dk[kFx], 0.0, dk[kCx], dk[kFy], dk[kCy]};
  }

  template <class Parameter, class Real>
  static void distort(const Parameter* k, Real x, Real y, Real& u, Real& v) {
    const Real q = x * x + y * y;
    const Real ratio = value_of<AngleRatio>(q);
    const Real scale = ratio * polynomial(k, ratio * ratio * q);
    u = scale * x * k[kFx] + k[kCx];
    v = scale * y * k[kFy] + k[kCy];
  }

  template <class Parameter, class Real>
  static void linearize(const Parameter* k, Real x, Real y, LinearizedLens<Real, 8>& out) {
    const Real q = x * x + y * y;
    const Real ratio = value_of<AngleRatio>(q);
    const Real t = ratio * ratio * q;
    const Real scale = ratio * polynomial(k, t);
    // dt/dq = h / (1 + q)
    const Real slope = slope_of<AngleRatio>(q) * polynomial(k, t) +
                       ratio * polynomial_slope(k, t) * (ratio / (q + 1.0));
    const Real xx = scale + slope * x * x * 2.0, xy = slope * x * y * 2.0;
    const Real yy = scale + slope * y * y * 2.0;
    out.u = scale * x * k[kFx] + k[kCx];
    out.v = scale * y * k[kFy] + k[kCy];
    out.plane[0][0] = xx * k[kFx];
    out.plane[0][1] = xy * k[kFx];
    out.plane[1][0] = xy * k[kFy];
    out.plane[1][1] = yy * k[kFy];
    const Real zero(0.0), one(1.0);
    set(out, kFx, scale * x, zero);
    set(out, kFy, zero, scale * y);
    set(out, kCx, one, zero);
    set(out, kCy, zero, one);
    Real power = ratio * t;
    for (int i = 0; i < kTerms; ++i) {
      set(out, kK1 + i, power * x * k[kFx], power * y * k[kFy]);
      power = power * t;
    }
  }

 private:
  template <class Real>
  static void set(LinearizedLens<Real, 8>& out, int column, Real u, Real v) {
    out.intrinsics[0][column] = u;
    out.intrinsics[1][column] = v;
  }

  // 1 + k1 t + k2 t² + …
  template <class Parameter, class Real>
  static Real polynomial(const Parameter* k, Real t) {
    Real value = t * k[kK1 + kTerms - 1];
    for (int i = kTerms - 2; i >= 0; --i) value = (value + k[kK1 + i]) * t;
    return value + 1.0;
  }
  template <class Parameter, class Real>
  static Real polynomial_slope(const Parameter* k, Real t) {
    Real value = Real(k[kK1 + kTerms - 1]) * double(kTerms);
    for (int i = kTerms - 2; i >= 0; --i) value = value * t + k[kK1 + i] * double(i + 1);
    return value;
  }
};

// The name that sfmcpp looks for.
struct PluginCamera : MetricCamera<FisheyeLens> {
  // A row for the tests, in which every derivative counts.
  static constexpr std::array<double, 8> kExample{420, 430, 300, 250, 0.05, -0.03, 0.02, -0.01};
};

}  // namespace sfmcpp

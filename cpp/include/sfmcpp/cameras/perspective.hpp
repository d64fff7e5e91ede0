// A perspective camera with any of its intrinsic parameters free: f, aspect, cx, cy, skew, radial
// distortion k1 … k5 and tangential distortion p1, p2 (Brown's model, as OpenCV and Bouguet have
// it).
#pragma once

#include <array>
#include <string_view>

#include "sfmcpp/cameras/camera_concept.hpp"

namespace sfmcpp {

// (x_d, y_d) = (1 + k1 r² + … + k5 r¹⁰) (x, y) + (2 p1 x y + p2 (r² + 2x²), p1 (r² + 2y²) + 2 p2 x
// y); u = f x_d + skew y_d + cx, v = aspect f y_d + cy.
struct PerspectiveLens {
  static constexpr std::array<std::string_view, 12> kNames{
      "f", "aspect", "cx", "cy", "skew", "k1", "k2", "k3", "k4", "k5", "p1", "p2"};
  static constexpr int kIntrinsics = 12;
  static constexpr bool kDistorts = true;
  static constexpr int kRadial = 5;
  enum Parameter { kF, kAspect, kCx, kCy, kSkew, kK1, kP1 = kK1 + kRadial, kP2 };

  SFMCPP_INLINE static Pinhole pinhole(const double* k) {
    return {k[kF], k[kSkew], k[kCx], k[kF] * k[kAspect], k[kCy]};
  }
  SFMCPP_INLINE static Pinhole pinhole_change(const double* k, const double* dk) {
    return {dk[kF], dk[kSkew], dk[kCx], dk[kF] * k[kAspect] + k[kF] * dk[kAspect], dk[kCy]};
  }

  template <class Real>
  struct Distorted {
    Real r2, radial, radial_slope;  // radial_slope = d(radial)/d(r²)
    Real x, y;
  };

  template <class Parameter, class Real>
  static Distorted<Real> distorted(const Parameter* k, Real x, Real y) {
    Distorted<Real> d;
    d.r2 = x * x + y * y;
    d.radial = Real(k[kK1 + kRadial - 1]);
    d.radial_slope = Real(0.0);
    for (int i = kRadial - 2; i >= 0; --i) {
      d.radial_slope = d.radial_slope * d.r2 + d.radial;
      d.radial = d.radial * d.r2 + k[kK1 + i];
    }
    d.radial_slope = d.radial_slope * d.r2 + d.radial;
    d.radial = d.radial * d.r2 + 1.0;
    const Real xy2 = x * y * 2.0;
    d.x = d.radial * x + xy2 * k[kP1] + (d.r2 + x * x * 2.0) * k[kP2];
    d.y = d.radial * y + (d.r2 + y * y * 2.0) * k[kP1] + xy2 * k[kP2];
    return d;
  }

  template <class Parameter, class Real>
  static void distort(const Parameter* k, Real x, Real y, Real& u, Real& v) {
    const Distorted<Real> d = distorted(k, x, y);
    to_pixels(k, d.x, d.y, u, v);
  }

  template <class Parameter, class Real>
  static void linearize(const Parameter* k, Real x, Real y, LinearizedLens<Real, 12>& out) {
    const Distorted<Real> d = distorted(k, x, y);
    to_pixels(k, d.x, d.y, out.u, out.v);
    linearize_plane(k, x, y, d, out);
    linearize_matrix(k, d, out);
    linearize_distortion(k, x, y, d.r2, out);
  }

 private:
  template <class Parameter, class Real>
  static void to_pixels(const Parameter* k, Real x, Real y, Real& u, Real& v) {
    u = x * k[kF] + y * k[kSkew] + k[kCx];
    v = y * (k[kF] * k[kAspect]) + k[kCy];
  }

  // Carries derivatives (dx, dy) of the distorted point to pixels.
  template <class Parameter, class Real>
  static void carry(const Parameter* k, Real dx, Real dy, Real& du, Real& dv) {
    du = dx * k[kF] + dy * k[kSkew];
    dv = dy * (k[kF] * k[kAspect]);
  }

  template <class Parameter, class Real>
  static void linearize_plane(
      const Parameter* k, Real x, Real y, const Distorted<Real>& d, LinearizedLens<Real, 12>& out) {
    const Real slope2 = d.radial_slope * 2.0;
    const Real xx = d.radial + slope2 * x * x + y * (2.0 * k[kP1]) + x * (6.0 * k[kP2]);
    const Real xy = slope2 * x * y + x * (2.0 * k[kP1]) + y * (2.0 * k[kP2]);
    const Real yy = d.radial + slope2 * y * y + y * (6.0 * k[kP1]) + x * (2.0 * k[kP2]);
    carry(k, xx, xy, out.plane[0][0], out.plane[1][0]);
    carry(k, xy, yy, out.plane[0][1], out.plane[1][1]);
  }

  template <class Parameter, class Real>
  static void linearize_matrix(const Parameter* k,
                               const Distorted<Real>& d,
                               LinearizedLens<Real, 12>& out) {
    const Real zero(0.0), one(1.0);
    const Real columns[5][2] = {
        {d.x, d.y * k[kAspect]}, {zero, d.y * k[kF]}, {one, zero}, {zero, one}, {d.y, zero}};
    for (int i = 0; i < 5; ++i) {
      out.intrinsics[0][i] = columns[i][0];
      out.intrinsics[1][i] = columns[i][1];
    }
  }

  template <class Parameter, class Real>
  static void linearize_distortion(
      const Parameter* k, Real x, Real y, Real r2, LinearizedLens<Real, 12>& out) {
    Real power = r2;
    for (int i = 0; i < kRadial; ++i) {
      carry(k, power * x, power * y, out.intrinsics[0][kK1 + i], out.intrinsics[1][kK1 + i]);
      power = power * r2;
    }
    const Real xy2 = x * y * 2.0;
    carry(k, xy2, r2 + y * y * 2.0, out.intrinsics[0][kP1], out.intrinsics[1][kP1]);
    carry(k, r2 + x * x * 2.0, xy2, out.intrinsics[0][kP2], out.intrinsics[1][kP2]);
  }
};

using PerspectiveCamera = MetricCamera<PerspectiveLens>;

}  // namespace sfmcpp

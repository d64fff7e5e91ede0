// An uncalibrated camera: any 3×4 matrix P of rank three, and homogeneous world points Q of four
// numbers (thesis §3.1.1, §4.3.2). Neither the scale of P nor that of Q is seen in an image; both
// are kept at norm one. The world is known up to a projective transformation, 15 degrees of freedom
// that damping holds.
#pragma once

#include <array>
#include <cmath>
#include <string_view>

#include "sfmcpp/cameras/camera_concept.hpp"

namespace sfmcpp {

// With (x, y, w) = P Q: u = scale x / w + cx, v = scale y / w + cy. The frame (scale, cx, cy) of
// the image is fixed: Hartley's isotropic normalisation (thesis eq. 4.3), which keeps the entries
// of P of one size; (1, 0, 0) leaves P in pixels.
struct ProjectiveCamera {
  static constexpr std::array<std::string_view, 3> kIntrinsicNames{"scale", "cx", "cy"};
  static constexpr bool kMetric = false;
  static constexpr int kTangent = 12;    // P ← P + δP, row-major
  static constexpr int kIntrinsics = 0;  // none is ever free
  static constexpr int kPointStorage = 4;

  template <class Parameter, class Real>
  static ImagePoint<Real> project(const Parameter* p, const Parameter* frame, const Real* q) {
    Real x[3];
    multiply(p, q, x);
    const Real inverse = Real(1.0) / x[2];
    // A projective camera has no front: only a point at w = 0 is not in the image.
    return {
        x[0] * inverse * frame[0] + frame[1], x[1] * inverse * frame[0] + frame[2], x[2] * x[2]};
  }

  // The same along a step from P and Q (camera_concept.hpp).
  template <class Real>
  static void project_along(const double* p,
                            const double* delta,
                            const double*,
                            const Jet<Real>* frame,
                            const Real* q,
                            const Real* step,
                            Jet<Real>& u,
                            Jet<Real>& v) {
    Real point[4], change[4];
    homogeneous(q, step, point, change);
    Jet<Real> entries[12], moving[4], x[3];
    for (int k = 0; k < 12; ++k) entries[k] = {Real(p[k]), Real(delta[k]), Real(0.0)};
    for (int k = 0; k < 4; ++k) moving[k] = {point[k], change[k], Real(0.0)};
    multiply(entries, moving, x);
    const Jet<Real> inverse = reciprocal(x[2]);
    u = x[0] * inverse * frame[0] + frame[1];
    v = x[1] * inverse * frame[0] + frame[2];
  }

  // ∂u/∂P: scale/w (Q, 0, −(x/w) Q); ∂u/∂Q: scale/w (P₁ − (x/w) P₃), carried to the tangent of Q.
  template <class Parameter, class Real>
  static void linearize(const Parameter* p,
                        const Parameter* frame,
                        const Real* q,
                        LinearizedImagePoint<Real, kTangent, kIntrinsics>& out) {
    Real x[3], basis[4][3];
    multiply(p, q, x);
    tangent_basis(q, basis);
    const Real inverse = Real(1.0) / x[2];
    const Real ratio[2] = {x[0] * inverse, x[1] * inverse};
    const Real slope = inverse * frame[0];
    out.image = {ratio[0] * frame[0] + frame[1], ratio[1] * frame[0] + frame[2], x[2] * x[2]};
    for (int row = 0; row < 2; ++row) {
      for (int c = 0; c < 3; ++c) out.point[row][c] = Real(0.0);
      for (int k = 0; k < 4; ++k) {
        out.camera[row][4 * row + k] = slope * q[k];
        out.camera[row][4 * (1 - row) + k] = Real(0.0);
        out.camera[row][8 + k] = -(slope * ratio[row] * q[k]);
        const Real by_q = slope * (Real(p[4 * row + k]) - ratio[row] * p[8 + k]);
        for (int c = 0; c < 3; ++c) out.point[row][c] += by_q * basis[k][c];
      }
    }
  }

  template <class Entry, class Real>
  static void multiply(const Entry* p, const Real* q, Real* x) {
    for (int row = 0; row < 3; ++row) {
      const Entry* r = p + 4 * row;
      x[row] = q[0] * r[0] + q[1] * r[1] + q[2] * r[2] + q[3] * r[3];
    }
  }

  // Three directions at right angles to Q and to one another, of the norm of Q: the imaginary units
  // times the quaternion Q. Smooth everywhere, as on no other sphere.
  template <class Real>
  static void tangent_basis(const Real* q, Real basis[4][3]) {
    const Real columns[3][4] = {
        {-q[1], q[0], -q[3], q[2]}, {-q[2], q[3], q[0], -q[1]}, {-q[3], -q[2], q[1], q[0]}};
    for (int k = 0; k < 4; ++k) {
      for (int c = 0; c < 3; ++c) basis[k][c] = columns[c][k];
    }
  }

  // Q as it is, and what a step of the tangent adds to it.
  template <class Real>
  static void homogeneous(const Real* q, const Real* step, Real* point, Real* change) {
    Real basis[4][3];
    tangent_basis(q, basis);
    for (int k = 0; k < 4; ++k) {
      point[k] = q[k];
      change[k] = basis[k][0] * step[0] + basis[k][1] * step[1] + basis[k][2] * step[2];
    }
  }

  static void plus(const double* p, const double* delta, double* result) {
    for (int k = 0; k < 12; ++k) result[k] = p[k] + delta[k];
  }
  static void plus_point(const double* q, const double* delta, double* result) {
    double point[4], change[4];
    homogeneous(q, delta, point, change);
    for (int k = 0; k < 4; ++k) result[k] = point[k] + change[k];
  }

  // A direction in the tangent of `q`, in the tangent of the point `at` that it has led to; what is
  // left out is along `at`, where no image changes.
  static void transport(const double* q, const double* step, const double* at, double* result) {
    double point[4], change[4], basis[4][3], norm2 = 0.0;
    homogeneous(q, step, point, change);
    tangent_basis(at, basis);
    for (int k = 0; k < 4; ++k) norm2 += at[k] * at[k];
    for (int c = 0; c < 3; ++c) {
      result[c] = 0.0;
      for (int k = 0; k < 4; ++k) result[c] += basis[k][c] * change[k] / norm2;
    }
  }

  // The scales that no image sees.
  static void normalize(double* p) { to_unit_norm(p, 12); }
  static void normalize_point(double* q) { to_unit_norm(q, 4); }

  // The matrix to pixels, and its change along a step: exact, as the update is additive.
  static void matrix(const double* p,
                     const double* frame,
                     const double* delta,
                     const double*,
                     MatrixAndChange& out) {
    for (int k = 0; k < 12; ++k) {
      const double centre = k < 4 ? frame[1] : k < 8 ? frame[2] : 0.0;
      const double scale = k < 8 ? frame[0] : 1.0;
      out.matrix[k] = scale * p[k] + centre * p[8 + k % 4];
      out.change[k] = scale * delta[k] + centre * delta[8 + k % 4];
    }
  }

  template <int kSteps = kExactly, class Real>
  static void undistort(const double*, Real u, Real v, Real& ideal_u, Real& ideal_v) {
    ideal_u = u;
    ideal_v = v;
  }

 private:
  static void to_unit_norm(double* values, int count) {
    double norm2 = 0.0;
    for (int k = 0; k < count; ++k) norm2 += values[k] * values[k];
    const double inverse = norm2 > 0.0 ? 1.0 / std::sqrt(norm2) : 1.0;
    for (int k = 0; k < count; ++k) values[k] *= inverse;
  }
};

}  // namespace sfmcpp

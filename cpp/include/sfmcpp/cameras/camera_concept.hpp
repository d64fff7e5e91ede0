// The interface of a camera model, and the part that all metric cameras share.
//
// Everything is a template on the number type `Real`: `double` for reference and tests, a Pack of
// doubles for the kernels, which treat several observations of one camera at once.
#pragma once

#include "sfmcpp/cameras/pose.hpp"
#include "sfmcpp/core/simd.hpp"
#include "sfmcpp/math/jet.hpp"

namespace sfmcpp {

template <class Real>
struct ImagePoint {
  Real u, v;   // pixels
  Real depth;  // along the optical axis; not positive: behind the camera
};

// Image point and its derivatives. `camera` columns: the camera's tangent; `intrinsics` columns:
// one for each intrinsic parameter.
template <class Real, int kTangent, int kIntrinsics>
struct LinearizedImagePoint {
  ImagePoint<Real> image;
  Real camera[2][kTangent];
  Real point[2][3];
  Real intrinsics[2][kIntrinsics > 0 ? kIntrinsics : 1];
};

// A 3×4 projection matrix to pixels, row-major, and its first-order change along a step.
struct MatrixAndChange {
  double matrix[12];
  double change[12];
};

// The upper triangle of a calibration matrix, or a change of it.
struct Pinhole {
  double fx, skew, cx, fy, cy;
};

// A lens maps the normalised image plane to pixels: `distort` gives (u, v); `linearize` also the
// 2×2 derivative by (x, y) and the 2×kIntrinsics derivative by the intrinsic parameters.
template <class Real, int kIntrinsics>
struct LinearizedLens {
  Real u, v;
  Real plane[2][2];
  Real intrinsics[2][kIntrinsics > 0 ? kIntrinsics : 1];
};

// Newton steps that take out a strong distortion to rounding. Two leave an error of the order of a
// hundredth of a pixel.
inline constexpr int kExactly = 8;

// The normalised point that the lens takes to (u, v), by Newton's method from the undistorted
// guess; that guess itself where Newton's method goes astray (beyond the range in which a lens is
// invertible; a strong lens takes points of the other side there, too).
template <int kSteps, class Lens, class Real>
SFMCPP_INLINE void undistorted(const double* intrinsics, Real u, Real v, Real& x, Real& y) {
  const Pinhole k = Lens::pinhole(intrinsics);
  const Real guess_y = (v - k.cy) * (1.0 / k.fy);
  const Real guess_x = (u - k.cx - guess_y * k.skew) * (1.0 / k.fx);
  x = guess_x;
  y = guess_y;
  if constexpr (Lens::kDistorts) {
    constexpr double kTolerance2 = 0.25;  // px²
    LinearizedLens<Real, Lens::kIntrinsics> lens;
    for (int step = 0; step < kSteps; ++step) {
      Lens::linearize(intrinsics, x, y, lens);
      const Real du = u - lens.u, dv = v - lens.v;
      const auto& j = lens.plane;
      const Real inverse = Real(1.0) / (j[0][0] * j[1][1] - j[0][1] * j[1][0]);
      x += (j[1][1] * du - j[0][1] * dv) * inverse;
      y += (j[0][0] * dv - j[1][0] * du) * inverse;
    }
    Real again_u, again_v;
    Lens::distort(intrinsics, x, y, again_u, again_v);
    const Real error2 = (again_u - u) * (again_u - u) + (again_v - v) * (again_v - v);
    const Real same_side = x * guess_x + y * guess_y;
    const Real trusted = select_less(error2, Real(kTolerance2), same_side, Real(0.0));
    x = select_less(Real(0.0), trusted, x, guess_x);
    y = select_less(Real(0.0), trusted, y, guess_y);
  }
}

// Poses [R | c] and points in a Euclidean world, whatever images they have.
struct MetricSpace {
  static constexpr bool kMetric = true;
  static constexpr int kTangent = 6;
  static constexpr int kPointStorage = 3;

  static void plus(const double* camera, const double* delta, double* result) {
    plus_pose(camera, delta, result);
  }
  static void plus_point(const double* point, const double* delta, double* result) {
    for (int k = 0; k < 3; ++k) result[k] = point[k] + delta[k];
  }
  static void transport(const double*, const double* step, const double*, double* result) {
    for (int k = 0; k < 3; ++k) result[k] = step[k];
  }
  static void normalize(double*) {}
  static void normalize_point(double*) {}

  // x_cam = Rᵀ (X − c).
  template <class Parameter, class Real>
  static void to_camera(const Parameter* camera, const Real* point, Real* x) {
    const Real dx = point[0] - camera[3], dy = point[1] - camera[7], dz = point[2] - camera[11];
    for (int k = 0; k < 3; ++k) x[k] = dx * camera[k] + dy * camera[4 + k] + dz * camera[8 + k];
  }

  // exp(−[α ω + ½ α² γ]×) (y + α m − ½ α² b) with y = Rᵀ (X − c), m = Rᵀ (δX − δc), ω = δR and the
  // bend (γ, b): derivatives m − ω × y and −2 ω × m + ω × (ω × y) − γ × y − b.
  template <class Real>
  static void to_camera_along(const double* camera,
                              const double* delta,
                              const double* bend,
                              const Real* point,
                              const Real* step,
                              Jet<Real>* x) {
    const double motion[12] = {camera[0],
                               camera[1],
                               camera[2],
                               delta[3],
                               camera[4],
                               camera[5],
                               camera[6],
                               delta[4],
                               camera[8],
                               camera[9],
                               camera[10],
                               delta[5]};
    Real y[3], m[3], turned[3], turned_m[3], turned_twice[3], bent[3];
    to_camera(camera, point, y);
    to_camera(motion, step, m);
    cross(delta, y, turned);
    cross(delta, m, turned_m);
    cross(delta, turned, turned_twice);
    cross(bend, y, bent);
    for (int k = 0; k < 3; ++k)
      x[k] = {y[k], m[k] - turned[k], turned_twice[k] - turned_m[k] * 2.0 - bent[k] - bend[3 + k]};
  }

  template <class Real>
  static void cross(const double* w, const Real* x, Real* out) {
    for (int k = 0; k < 3; ++k)
      out[k] = x[(k + 2) % 3] * w[(k + 1) % 3] - x[(k + 1) % 3] * w[(k + 2) % 3];
  }

  // Note eqs 5–10: with a row a of A = ∂(u, v)/∂x_cam, the derivatives are a [x_cam]× by δR, −a Rᵀ
  // by δc and a Rᵀ by δX.
  template <class Parameter, class Real>
  static void carry_to_world(const Parameter* camera,
                             const Real* x,
                             Real ax,
                             Real ay,
                             Real az,
                             Real* by_camera,
                             Real* by_point) {
    by_camera[0] = ay * x[2] - az * x[1];
    by_camera[1] = az * x[0] - ax * x[2];
    by_camera[2] = ax * x[1] - ay * x[0];
    for (int k = 0; k < 3; ++k) {
      const Parameter* r = camera + 4 * k;  // row k of R: column k of Rᵀ
      by_point[k] = ax * r[0] + ay * r[1] + az * r[2];
      by_camera[3 + k] = -by_point[k];
    }
  }
};

// Pose [R | c] followed by division by the depth, followed by a lens.
template <class Lens>
struct MetricCamera : MetricSpace {
  static constexpr auto kIntrinsicNames = Lens::kNames;
  static constexpr int kIntrinsics = Lens::kIntrinsics;

  template <class Parameter, class Real>
  static ImagePoint<Real> project(const Parameter* camera,
                                  const Parameter* intrinsics,
                                  const Real* point) {
    Real x[3];
    to_camera(camera, point, x);
    const Real inverse_depth = Real(1.0) / x[2];
    ImagePoint<Real> image;
    Lens::distort(intrinsics, x[0] * inverse_depth, x[1] * inverse_depth, image.u, image.v);
    image.depth = x[2];
    return image;
  }

  // The image along α ↦ (R exp([α δR + ½ α² γ]×), c + α δc + ½ α² R b; X + α δX), with the bend
  // (γ, b) and the intrinsics along the same path: exact up to the second derivative.
  template <class Real>
  static void project_along(const double* camera,
                            const double* delta,
                            const double* bend,
                            const Jet<Real>* intrinsics,
                            const Real* point,
                            const Real* step,
                            Jet<Real>& u,
                            Jet<Real>& v) {
    Jet<Real> x[3];
    to_camera_along(camera, delta, bend, point, step, x);
    const Jet<Real> inverse_depth = reciprocal(x[2]);
    Lens::distort(intrinsics, x[0] * inverse_depth, x[1] * inverse_depth, u, v);
  }

  template <class Parameter, class Real>
  static void linearize(const Parameter* camera,
                        const Parameter* intrinsics,
                        const Real* point,
                        LinearizedImagePoint<Real, kTangent, kIntrinsics>& out) {
    Real x[3];
    to_camera(camera, point, x);
    const Real inverse_depth = Real(1.0) / x[2];
    const Real px = x[0] * inverse_depth, py = x[1] * inverse_depth;
    LinearizedLens<Real, kIntrinsics> lens;
    Lens::linearize(intrinsics, px, py, lens);
    out.image = {lens.u, lens.v, x[2]};
    for (int row = 0; row < 2; ++row) {
      const Real ax = lens.plane[row][0] * inverse_depth;
      const Real ay = lens.plane[row][1] * inverse_depth;
      const Real az = -(ax * px + ay * py);
      carry_to_world(camera, x, ax, ay, az, out.camera[row], out.point[row]);
      for (int k = 0; k < kIntrinsics; ++k) out.intrinsics[row][k] = lens.intrinsics[row][k];
    }
  }

  // (X, 1), and what a step adds to it.
  template <class Real>
  static void homogeneous(const Real* x, const Real* step, Real* point, Real* change) {
    for (int k = 0; k < 3; ++k) {
      point[k] = x[k];
      change[k] = step[k];
    }
    point[3] = Real(1.0);
    change[3] = Real(0.0);
  }

  // P = K [Rᵀ | −Rᵀc] and, to first order,
  // ΔP = K [−[δR]× Rᵀ | [δR]× Rᵀ c − Rᵀ δc] + ΔK [Rᵀ | −Rᵀc] (docs/equations.md §5; thesis eq. 4.20
  // is for another parametrisation and a fixed K). Distortion is left out: see `undistort`.
  static void matrix(const double* camera,
                     const double* intrinsics,
                     const double* delta,
                     const double* intrinsics_delta,
                     MatrixAndChange& out) {
    double view[12], view_change[12];
    for (int row = 0; row < 3; ++row) {
      view[4 * row + 3] = view_change[4 * row + 3] = 0.0;
      for (int k = 0; k < 3; ++k) {
        view[4 * row + k] = camera[4 * k + row];
        view[4 * row + 3] -= camera[4 * k + row] * camera[4 * k + 3];
      }
    }
    for (int k = 0; k < 4; ++k) {  // −[δR]× applied to each column of [Rᵀ | −Rᵀc]
      view_change[k] = delta[2] * view[4 + k] - delta[1] * view[8 + k];
      view_change[4 + k] = delta[0] * view[8 + k] - delta[2] * view[k];
      view_change[8 + k] = delta[1] * view[k] - delta[0] * view[4 + k];
    }
    for (int row = 0; row < 3; ++row) {
      for (int k = 0; k < 3; ++k) view_change[4 * row + 3] -= camera[4 * k + row] * delta[3 + k];
    }
    const Pinhole k = Lens::pinhole(intrinsics);
    const Pinhole dk = Lens::pinhole_change(intrinsics, intrinsics_delta);
    for (int c = 0; c < 4; ++c) {
      const double *v = view + c, *dv = view_change + c;
      out.matrix[c] = k.fx * v[0] + k.skew * v[4] + k.cx * v[8];
      out.matrix[4 + c] = k.fy * v[4] + k.cy * v[8];
      out.matrix[8 + c] = v[8];
      out.change[c] = k.fx * dv[0] + k.skew * dv[4] + k.cx * dv[8] + dk.fx * v[0] + dk.skew * v[4] +
                      dk.cx * v[8];
      out.change[4 + c] = k.fy * dv[4] + k.cy * dv[8] + dk.fy * v[4] + dk.cy * v[8];
      out.change[8 + c] = dv[8];
    }
  }

  // Where a lens without distortion, of the same pinhole, would have seen what was seen at (u, v).
  template <int kSteps = kExactly, class Real>
  static void undistort(const double* intrinsics, Real u, Real v, Real& ideal_u, Real& ideal_v) {
    Real x, y;
    undistorted<kSteps, Lens>(intrinsics, u, v, x, y);
    const Pinhole k = Lens::pinhole(intrinsics);
    ideal_u = x * k.fx + y * k.skew + k.cx;
    ideal_v = y * k.fy + k.cy;
  }
};

}  // namespace sfmcpp

// What the solver asks of a camera model, and the part that all metric cameras share.
//
// Everything is a template on the number type `Real`: `double` for reference and tests, a Pack of
// doubles for the kernels, which treat several observations of one camera at once.
#pragma once

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

// A lens maps the normalised image plane to pixels: `distort` gives (u, v); `linearize` also the
// 2×2 derivative by (x, y) and the 2×kIntrinsics derivative by the intrinsic parameters.
template <class Real, int kIntrinsics>
struct LinearizedLens {
  Real u, v;
  Real plane[2][2];
  Real intrinsics[2][kIntrinsics > 0 ? kIntrinsics : 1];
};

// Pose [R | c] followed by division by the depth, followed by a lens.
template <class Lens>
struct MetricCamera {
  static constexpr int kTangent = 6;
  static constexpr int kIntrinsics = Lens::kIntrinsics;

  template <class Real>
  static ImagePoint<Real> project(const double* camera,
                                  const double* intrinsics,
                                  const Real* point) {
    Real x[3];
    to_camera(camera, point, x);
    const Real inverse_depth = Real(1.0) / x[2];
    ImagePoint<Real> image;
    Lens::distort(intrinsics, x[0] * inverse_depth, x[1] * inverse_depth, image.u, image.v);
    image.depth = x[2];
    return image;
  }

  // Note eqs 5–10: with A = ∂(u, v)/∂x_cam, the derivatives are A [x_cam]× by δR, −A Rᵀ by δc and
  // A Rᵀ by δX.
  template <class Real>
  static void linearize(const double* camera,
                        const double* intrinsics,
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
      out.camera[row][0] = ay * x[2] - az * x[1];
      out.camera[row][1] = az * x[0] - ax * x[2];
      out.camera[row][2] = ax * x[1] - ay * x[0];
      for (int k = 0; k < 3; ++k) {
        const double* r = camera + 4 * k;  // row k of R: column k of Rᵀ
        out.point[row][k] = ax * r[0] + ay * r[1] + az * r[2];
        out.camera[row][3 + k] = -out.point[row][k];
      }
      for (int k = 0; k < kIntrinsics; ++k) out.intrinsics[row][k] = lens.intrinsics[row][k];
    }
  }

  // x_cam = Rᵀ (X − c).
  template <class Real>
  static void to_camera(const double* camera, const Real* point, Real* x) {
    const Real dx = point[0] - camera[3], dy = point[1] - camera[7], dz = point[2] - camera[11];
    for (int k = 0; k < 3; ++k) x[k] = dx * camera[k] + dy * camera[4 + k] + dz * camera[8 + k];
  }
};

}  // namespace sfmcpp

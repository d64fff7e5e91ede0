// Reprojection residual of BAL's camera (Snavely's): with P = R(w) X + t and p = -P.xy / P.z,
//
//     r = f (1 + k1 |p|^2 + k2 |p|^4) p - observed,      camera = (w, t, f, k1, k2).
//
// Twice: with Ceres' automatic derivatives, and with derivatives by hand, to give Ceres the faster
// one.
#pragma once

#include <cmath>

#include <ceres/ceres.h>
#include <ceres/rotation.h>

struct AutoDiffReprojection {
  double u_px, v_px;

  template <typename T>
  bool operator()(const T* camera, const T* point, T* residual) const {
    T p[3];
    ceres::AngleAxisRotatePoint(camera, point, p);
    for (int i = 0; i < 3; ++i) p[i] += camera[3 + i];
    const T x = -p[0] / p[2];
    const T y = -p[1] / p[2];
    const T r2 = x * x + y * y;
    const T scale = camera[6] * (1.0 + r2 * (camera[7] + camera[8] * r2));
    residual[0] = scale * x - u_px;
    residual[1] = scale * y - v_px;
    return true;
  }

  static ceres::CostFunction* Create(double u_px, double v_px) {
    using Function = ceres::AutoDiffCostFunction<AutoDiffReprojection, 2, 9, 3>;
    return new Function(new AutoDiffReprojection{u_px, v_px});
  }
};

// Rotation matrix (row major) of an angle-axis vector, and the coefficients of the left Jacobian of
// SO(3), Jl = s I + (1 - s) a a' + c [a]x   (Barfoot, State Estimation for Robotics, eq. 7.77).
struct Rotation {
  double R[9];
  double a[3];
  double s, c;

  explicit Rotation(const double* w) {
    const double angle = std::sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    const double inverse = angle > 0.0 ? 1.0 / angle : 0.0;
    const double sin_angle = std::sin(angle), cos_angle = std::cos(angle),
                 versine = 1.0 - cos_angle;
    for (int i = 0; i < 3; ++i) a[i] = w[i] * inverse;
    s = angle > 0.0 ? sin_angle * inverse : 1.0;
    c = versine * inverse;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) R[3 * i + j] = versine * a[i] * a[j];
      R[4 * i] += cos_angle;
    }
    R[1] -= sin_angle * a[2], R[2] += sin_angle * a[1], R[3] += sin_angle * a[2];
    R[5] -= sin_angle * a[0], R[6] -= sin_angle * a[1], R[7] += sin_angle * a[0];
  }
};

inline void Cross(const double* a, const double* b, double* out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

class AnalyticReprojection final : public ceres::SizedCostFunction<2, 9, 3> {
 public:
  AnalyticReprojection(double u_px, double v_px) : observed_{u_px, v_px} {}

  bool Evaluate(double const* const* parameters,
                double* residual,
                double** jacobians) const override {
    const double *camera = parameters[0], *point = parameters[1];
    const Rotation rotation(camera);
    double rotated[3];
    for (int i = 0; i < 3; ++i) {
      const double* row = rotation.R + 3 * i;
      rotated[i] = row[0] * point[0] + row[1] * point[1] + row[2] * point[2];
    }
    const double inverse_z = 1.0 / (rotated[2] + camera[5]);
    const double p[2] = {-(rotated[0] + camera[3]) * inverse_z,
                         -(rotated[1] + camera[4]) * inverse_z};
    const double f = camera[6], r2 = p[0] * p[0] + p[1] * p[1];
    const double distortion = 1.0 + r2 * (camera[7] + camera[8] * r2);
    for (int i = 0; i < 2; ++i) residual[i] = f * distortion * p[i] - observed_[i];
    if (jacobians == nullptr) return true;

    const double slope = 2.0 * f * (camera[7] + 2.0 * camera[8] * r2);
    for (int i = 0; i < 2; ++i) {
      double by_p[2] = {slope * p[i] * p[0], slope * p[i] * p[1]};
      by_p[i] += f * distortion;
      const double by_P[3] = {-by_p[0] * inverse_z,
                              -by_p[1] * inverse_z,
                              -(by_p[0] * p[0] + by_p[1] * p[1]) * inverse_z};
      if (jacobians[0]) {
        double* row = jacobians[0] + 9 * i;
        ByRotation(rotation, rotated, by_P, row);
        for (int k = 0; k < 3; ++k) row[3 + k] = by_P[k];
        row[6] = distortion * p[i], row[7] = f * r2 * p[i], row[8] = f * r2 * r2 * p[i];
      }
      if (jacobians[1]) ByPoint(rotation.R, by_P, jacobians[1] + 3 * i);
    }
    return true;
  }

  static ceres::CostFunction* Create(double u_px, double v_px) {
    return new AnalyticReprojection(u_px, v_px);
  }

 private:
  // d(R X)/dw = -[R X]x Jl, hence row = h' Jl with h = (R X) x by_P.
  static void ByRotation(const Rotation& rotation,
                         const double* rotated,
                         const double* by_P,
                         double* row) {
    double h[3], h_cross_a[3];
    Cross(rotated, by_P, h);
    Cross(h, rotation.a, h_cross_a);
    const double along = h[0] * rotation.a[0] + h[1] * rotation.a[1] + h[2] * rotation.a[2];
    for (int k = 0; k < 3; ++k) {
      row[k] = rotation.s * h[k] + (1.0 - rotation.s) * along * rotation.a[k] +
               rotation.c * h_cross_a[k];
    }
  }

  static void ByPoint(const double* R, const double* by_P, double* row) {
    for (int k = 0; k < 3; ++k) row[k] = by_P[0] * R[k] + by_P[1] * R[3 + k] + by_P[2] * R[6 + k];
  }

  double observed_[2];
};

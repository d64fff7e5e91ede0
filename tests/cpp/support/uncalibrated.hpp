// What an uncalibrated camera makes of a metric one: P = T⁻¹ K [Rᵀ | −Rᵀc] and Q = (X, 1), both of
// norm one, with T the frame (scale, cx, cy) of the image.
#pragma once

#include <array>
#include <span>

#include <Eigen/Core>
#include <Eigen/LU>

#include "sfmcpp/cameras/camera_model.hpp"
#include "sfmcpp/cameras/matrix34.hpp"

namespace sfmcpp::support {

// Of an image of 640 × 480 pixels.
inline constexpr std::array<double, 3> kImageFrame{400.0, 320.0, 240.0};

// K of the rows f, aspect, cx, cy, skew that a calibrated camera has.
inline Eigen::Matrix3d calibration_matrix(std::span<const double> intrinsics) {
  const double f = intrinsics[0];
  Eigen::Matrix3d k;
  k << f, intrinsics[4], intrinsics[2], 0.0, f * intrinsics[1], intrinsics[3], 0.0, 0.0, 1.0;
  return k;
}

inline Eigen::Matrix3d frame_matrix(std::span<const double> frame) {
  Eigen::Matrix3d t;
  t << frame[0], 0.0, frame[1], 0.0, frame[0], frame[2], 0.0, 0.0, 1.0;
  return t;
}

// [Rᵀ | −Rᵀc].
inline Matrix34 view_matrix(const double* pose) {
  const Eigen::Map<const Matrix34> stored(pose);
  Matrix34 view;
  view.leftCols<3>() = stored.leftCols<3>().transpose();
  view.col(3) = -view.leftCols<3>() * stored.col(3);
  return view;
}

inline std::array<double, kCameraStorage> uncalibrated_camera(const double* pose,
                                                              const Eigen::Matrix3d& calibration,
                                                              std::span<const double> frame) {
  std::array<double, kCameraStorage> stored;
  const Eigen::Matrix3d inverse_frame = frame_matrix(frame).inverse();
  Eigen::Map<Matrix34>{stored.data()} =
      (inverse_frame * calibration * view_matrix(pose)).normalized();
  return stored;
}

inline Eigen::Vector4d homogeneous_point(const double* x) {
  return Eigen::Vector4d(x[0], x[1], x[2], 1.0).normalized();
}

}  // namespace sfmcpp::support

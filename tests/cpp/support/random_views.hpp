// A camera anywhere in the world and a point in its view, at random.
#pragma once

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include <Eigen/Geometry>

#include "sfmcpp/cameras/camera_model.hpp"

namespace sfmcpp::support {

struct View {
  Eigen::Matrix3d rotation;  // world_from_camera
  Eigen::Vector3d centre;
  Eigen::Vector3d point;
  std::vector<double> intrinsics;

  std::array<double, kCameraStorage> camera() const {
    std::array<double, kCameraStorage> stored;
    for (int row = 0; row < 3; ++row) {
      for (int k = 0; k < 3; ++k) stored[4 * row + k] = rotation(row, k);
      stored[4 * row + 3] = centre[row];
    }
    return stored;
  }
};

// Strong lenses, so that every term of every derivative counts.
inline std::vector<double> strong_intrinsics(CameraModelId model) {
  switch (model) {
    case CameraModelId::kPerspective:
      return {700, 1.1, 300, 250, 3, -0.3, 0.2, -0.1, 0.15, 0.05, 0.02, -0.03};
    case CameraModelId::kBal:
      return {700, -0.3, 0.2};
    case CameraModelId::kCalibrated:
      break;
  }
  return {700, 1.1, 300, 250, 3};
}

inline View random_view(CameraModelId model, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  View view;
  view.rotation = Eigen::Quaterniond(normal(random), normal(random), normal(random), normal(random))
                      .normalized()
                      .toRotationMatrix();
  view.centre = Eigen::Vector3d(normal(random), normal(random), normal(random)) * 5.0;
  const double depth = 6.0 + 4.0 * unit(random);
  // Away from the axis, where distortion has no effect to speak of.
  const auto slope = [&] { return std::copysign(0.45, unit(random)) + 0.2 * unit(random); };
  const double x = slope(), y = slope();
  const Eigen::Vector3d in_camera(x, y, 1.0);
  view.point = view.centre + view.rotation * (depth * in_camera);
  view.intrinsics = strong_intrinsics(model);
  return view;
}

}  // namespace sfmcpp::support

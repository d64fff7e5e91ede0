// A camera anywhere in the world and a point in its view, at random.
#pragma once

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include <Eigen/Geometry>

#include "sfmcpp/cameras/visit_camera.hpp"
#include "support/uncalibrated.hpp"

namespace sfmcpp::support {

// The calibration behind an uncalibrated camera, which knows none.
inline const std::vector<double> kCalibration{700, 1.1, 300, 250, 3};

struct View {
  CameraModelId model;
  Eigen::Matrix3d rotation;  // world_from_camera
  Eigen::Vector3d centre;
  Eigen::Vector3d point;
  std::vector<double> intrinsics;

  std::array<double, kCameraStorage> pose() const {
    std::array<double, kCameraStorage> stored;
    Eigen::Map<Matrix34> camera(stored.data());
    camera << rotation, centre;
    return stored;
  }

  // As the model stores them.
  std::array<double, kCameraStorage> camera() const {
    if (is_metric(model)) return pose();
    return uncalibrated_camera(pose().data(), calibration_matrix(kCalibration), intrinsics);
  }
  std::vector<double> stored_point() const {
    if (is_metric(model)) return {point.begin(), point.end()};
    const Eigen::Vector4d q = homogeneous_point(point.data());
    return {q.begin(), q.end()};
  }
};

// Strong lenses, so that every term of every derivative counts.
inline std::vector<double> strong_intrinsics(CameraModelId model) {
  switch (model) {
    case CameraModelId::kPerspective:
      return {700, 1.1, 300, 250, 3, -0.3, 0.2, -0.1, 0.15, 0.05, 0.02, -0.03};
    case CameraModelId::kBal:
      return {700, -0.3, 0.2};
    case CameraModelId::kProjective:
      return {kImageFrame.begin(), kImageFrame.end()};
    case CameraModelId::kPlugin:
#ifdef SFMCPP_CAMERA_PLUGIN
      return {PluginCamera::kExample.begin(), PluginCamera::kExample.end()};
#endif
    case CameraModelId::kCalibrated:
      break;
  }
  return kCalibration;
}

inline View random_view(CameraModelId model, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  View view;
  view.model = model;
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

// Consecutive observations of one camera, as the kernels get them.
#pragma once

#include <array>
#include <vector>

#include "sfmcpp/residuals/reprojection.hpp"
#include "support/camera_dispatch.hpp"
#include "support/random_views.hpp"

namespace sfmcpp::support {

// Of points in scrambled order, every third one behind the camera.
struct RandomBatch {
  RandomBatch(CameraModelId model_id, int size)
      : model(model_id), count(size), view_(random_view(model, 11)) {
    camera = view_.camera();
    intrinsics = view_.intrinsics;
    const int num_points = count + 3;
    for (int p = 0; p < num_points; ++p) add_point(p);
    point.assign(count + kReadAhead, 0);
    for (int k = 0; k < count; ++k) point[k] = (k * 7 + 2) % num_points;
    for (auto* values : {&u, &v, &inverse_sigma}) values->assign(count + kReadAhead, 1.0);
    for (int k = 0; k < count; ++k) {
      u[k] = 100.0 + 13.0 * k;
      v[k] = 200.0 - 9.0 * k;
      inverse_sigma[k] = 1.0 / (0.5 + 0.25 * k);
    }
  }

  residuals::ObservationBatch view() const {
    return {camera.data(),
            intrinsics.data(),
            points.data(),
            point.data(),
            u.data(),
            v.data(),
            inverse_sigma.data(),
            count};
  }
  const double* stored_point(int k) const {
    return points.data() + static_cast<long>(point_storage(model)) * point[k];
  }
  ImagePoint<double> image(int k) const {
    return project(model, camera.data(), intrinsics.data(), stored_point(k));
  }

  CameraModelId model;
  int count;
  std::array<double, kCameraStorage> camera;
  std::vector<double> intrinsics, points, u, v, inverse_sigma;
  std::vector<int> point;

 private:
  void add_point(int p) {
    const Eigen::Vector3d in_camera(0.1 * p - 0.7, 0.5 - 0.07 * p, 1.0);
    const double depth = p % 3 == 0 ? -2.0 - p : 2.0 + p;
    view_.point = view_.centre + view_.rotation * (depth * in_camera);
    const std::vector<double> stored = view_.stored_point();
    points.insert(points.end(), stored.begin(), stored.end());
  }

  View view_;
};

}  // namespace sfmcpp::support

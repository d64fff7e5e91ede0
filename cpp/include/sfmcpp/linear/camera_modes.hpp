// Directions of the cameras along which the cost is expected to change slowly when all cameras of a
// neighbourhood go along: the near-null space of S, for preconditioners. Whoever knows what a
// camera is fills them in; none: there are none.
#pragma once

#include <cstddef>
#include <vector>

namespace sfmcpp::linear {

struct CameraModes {
  int count = 0;
  std::vector<double> values;  // per camera: D × count, row-major

  double* of_camera(int camera, int camera_size) {
    return values.data() + static_cast<std::size_t>(camera) * camera_size * count;
  }
  const double* of_camera(int camera, int camera_size) const {
    return values.data() + static_cast<std::size_t>(camera) * camera_size * count;
  }
};

}  // namespace sfmcpp::linear

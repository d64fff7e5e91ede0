#include "sfmcpp/ba/ideal_images.hpp"

#include <algorithm>
#include <array>

#include "sfmcpp/cameras/visit_camera.hpp"

namespace sfmcpp::ba {
void projection_matrices(const Problem& problem, double* matrices) {
  constexpr std::array<double, 32> kNoChange{};
  visit_camera(problem.camera_model, [&](auto camera) {
    for (int i = 0; i < problem.num_cameras(); ++i) {
      MatrixAndChange line;
      decltype(camera)::matrix(problem.cameras.data() + problem.camera_offset(i),
                               problem.intrinsics.data() + problem.intrinsics_offset(i),
                               kNoChange.data(),
                               kNoChange.data(),
                               line);
      std::copy_n(line.matrix, kCameraStorage, matrices + problem.camera_offset(i));
    }
  });
}

void undistort_pixels(const Problem& problem, double* pixels) {
  visit_camera(problem.camera_model, [&](auto camera) {
    for (int k = 0; k < problem.num_observations(); ++k) {
      const double* seen = problem.pixels.data() + 2L * k;
      decltype(camera)::undistort(
          problem.intrinsics.data() + problem.intrinsics_offset(problem.camera_index[k]),
          seen[0],
          seen[1],
          pixels[2L * k],
          pixels[2L * k + 1]);
    }
  });
}

}  // namespace sfmcpp::ba

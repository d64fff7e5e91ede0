#include "sfmcpp/ba/ideal_images.hpp"

#include <algorithm>
#include <array>

#include "sfmcpp/cameras/visit_camera.hpp"

namespace sfmcpp::ba {
namespace {

const double* intrinsics_of(const Problem& problem, int camera) {
  return problem.intrinsics.data() +
         static_cast<long>(problem.num_intrinsics()) * problem.intrinsics_index[camera];
}

}  // namespace

void projection_matrices(const Problem& problem, double* matrices) {
  constexpr std::array<double, 32> kNoChange{};
  visit_camera(problem.camera_model, [&](auto camera) {
    for (int i = 0; i < problem.num_cameras(); ++i) {
      MatrixAndChange line;
      decltype(camera)::matrix(problem.cameras.data() + static_cast<long>(kCameraStorage) * i,
                               intrinsics_of(problem, i),
                               kNoChange.data(),
                               kNoChange.data(),
                               line);
      std::copy_n(line.matrix, kCameraStorage, matrices + static_cast<long>(kCameraStorage) * i);
    }
  });
}

void undistort_pixels(const Problem& problem, double* pixels) {
  visit_camera(problem.camera_model, [&](auto camera) {
    for (int k = 0; k < problem.num_observations(); ++k) {
      const double* seen = problem.pixels.data() + 2L * k;
      decltype(camera)::undistort(intrinsics_of(problem, problem.camera_index[k]),
                                  seen[0],
                                  seen[1],
                                  pixels[2L * k],
                                  pixels[2L * k + 1]);
    }
  });
}

}  // namespace sfmcpp::ba

#include "sfmcpp/ba/problem.hpp"

#include <algorithm>
#include <array>

#include "sfmcpp/cameras/visit_camera.hpp"

namespace sfmcpp::ba {

optim::State state_of(const Problem& problem) {
  return {.cameras = {problem.cameras.begin(), problem.cameras.end()},
          .intrinsics = {problem.intrinsics.begin(), problem.intrinsics.end()},
          .points = {problem.points.begin(), problem.points.end()},
          .sensors = {problem.rigs.sensors.begin(), problem.rigs.sensors.end()}};
}

linear::ObservationGraph graph_of(const Problem& problem, Exchange& exchange) {
  linear::ObservationGraph graph = graph_of_this_rank(problem);
  exchange.sum(graph.of_camera_on_all_ranks);
  return graph;
}

linear::ObservationGraph graph_of_this_rank(const Problem& problem) {
  return linear::make_observation_graph(
      problem.num_cameras(), problem.num_points(), problem.camera_index, problem.point_index);
}

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

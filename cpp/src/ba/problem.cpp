#include "sfmcpp/ba/problem.hpp"

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

}  // namespace sfmcpp::ba

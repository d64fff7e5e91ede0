#include "sfmcpp/ba/free_sensors.hpp"

#include "sfmcpp/core/disjoint_sets.hpp"

namespace sfmcpp::ba {
namespace {

constexpr int kNoSensor = -1;

// Sensors that frames hold together by what they see.
DisjointSets joined_sensors(const Problem& problem, const linear::ObservationGraph& graph) {
  DisjointSets rigs(problem.rigs.num_sensors());
  std::vector<int> of_frame(problem.num_cameras(), kNoSensor);
  for (int i = 0; i < problem.num_cameras(); ++i) {
    if (!graph.is_observed(i)) continue;
    int& first = of_frame[problem.rigs.frame_of_camera[i]];
    if (first == kNoSensor) first = problem.rigs.sensor_of_camera[i];
    rigs.join(problem.rigs.sensor_of_camera[i], first);
  }
  return rigs;
}

}  // namespace

FreeSensors::FreeSensors(const Problem& problem, const linear::ObservationGraph& graph)
    : problem_(problem),
      moves_(problem.rigs.num_sensors()),
      observed_(problem.rigs.num_sensors()),
      anchor_(problem.rigs.num_sensors(), kNoSensor) {
  if (problem.rigs.empty()) return;
  DisjointSets rigs = joined_sensors(problem, graph);
  std::vector<char> needs_anchor(moves_.size());
  for (int i = 0; i < problem.num_cameras(); ++i) {
    if (!graph.is_observed(i)) continue;
    const int sensor = problem.rigs.sensor_of_camera[i];
    observed_[sensor] = 1;
    needs_anchor[rigs.root(sensor)] |= static_cast<char>(!problem.is_fixed_camera(i));
  }
  const auto wanted = [&](int s) {
    return observed_[s] && !problem.rigs.free_sensors.empty() && problem.rigs.free_sensors[s];
  };
  std::vector<int> of_rig(moves_.size(), kNoSensor);
  for (int s = 0; s < problem.rigs.num_sensors(); ++s) {
    int& anchor = of_rig[rigs.root(s)];
    if (anchor == kNoSensor && !wanted(s)) anchor = s;
  }
  for (int s = 0; s < problem.rigs.num_sensors(); ++s) {
    int& anchor = of_rig[rigs.root(s)];
    if (anchor == kNoSensor && needs_anchor[rigs.root(s)]) anchor = s;
    moves_[s] = static_cast<char>(wanted(s) && s != anchor);
    anchor_[s] = anchor;
  }
}

std::vector<std::vector<int>> FreeSensors::cameras() const {
  std::vector<std::vector<int>> result(moves_.size());
  for (int i = 0; i < problem_.num_cameras() && !result.empty(); ++i)
    result[problem_.rigs.sensor_of_camera[i]].push_back(i);
  return result;
}

Eigen::Vector3d FreeSensors::anchor_in_rig(const optim::State& state, int sensor) const {
  if (anchor_[sensor] == kNoSensor) return Eigen::Vector3d::Zero();
  return sensor_at(state.sensors, anchor_[sensor]).col(3);
}

Eigen::Vector3d FreeSensors::lever(const optim::State& state, int sensor) const {
  return sensor_at(state.sensors, sensor).col(3) - anchor_in_rig(state, sensor);
}

Eigen::Vector3d FreeSensors::anchor(const Frames& frames,
                                    const optim::State& state,
                                    int camera) const {
  if (!frames.any()) return Eigen::Vector3d::Zero();
  return frames.pose(state, camera).leftCols<3>() *
         anchor_in_rig(state, problem_.rigs.sensor_of_camera[camera]);
}

std::vector<std::string> FreeSensors::warnings() const {
  std::vector<std::string> result;
  for (int s = 0; s < std::ssize(problem_.rigs.free_sensors); ++s) {
    if (!problem_.rigs.free_sensors[s] || moves_[s]) continue;
    result.push_back(
        "rigs.free_sensors[" + std::to_string(s) + "]: left as given: " +
        (observed_[s] ? "all sensors of its rig are free, and one must stay" : "no observations"));
  }
  return result;
}

}  // namespace sfmcpp::ba

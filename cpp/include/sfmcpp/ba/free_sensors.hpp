// Which sensors of rigs are estimated.
//
// Frames and sensors are known up to a motion of each rig against its frames: of the sensors that
// frames hold together one must stay where it is, unless the poses of all these frames are fixed. A
// sensor without observations stays, too. So a sensor that is free by the problem may stay.
#pragma once

#include <string>
#include <vector>

#include "sfmcpp/ba/rigs.hpp"

namespace sfmcpp::ba {

class FreeSensors {
 public:
  // The problem must outlive this object. The same on every rank.
  FreeSensors(const Problem& problem, const linear::ObservationGraph& graph);

  bool moves(int sensor) const { return moves_[sensor]; }
  bool camera_moves(int camera) const {
    return !moves_.empty() && moves_[problem_.rigs.sensor_of_camera[camera]];
  }
  // The cameras of each sensor.
  std::vector<std::vector<int>> cameras() const;

  // Where a rig grows from as the world does: the first of its sensors that stay, if there is one.
  // From there to a sensor, in the rig:
  Eigen::Vector3d lever(const optim::State& state, int sensor) const;
  // From the origin of a camera's frame to there, in the world.
  Eigen::Vector3d anchor(const Frames& frames, const optim::State& state, int camera) const;

  // Sensors that are free by the problem and stay.
  std::vector<std::string> warnings() const;

 private:
  Eigen::Vector3d anchor_in_rig(const optim::State& state, int sensor) const;

  const Problem& problem_;
  std::vector<char> moves_;
  std::vector<char> observed_;
  std::vector<int> anchor_;  // of each sensor, the first of its rig that stays
};

}  // namespace sfmcpp::ba

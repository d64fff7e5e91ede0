// Rigs: cameras that move together, each a sensor of a rigid frame.
//
// Camera i, sensor s of frame f, is where both put it: R_i = R_f R_s, c_i = c_f + R_f t_s, with the
// pose [R_f | c_f] of the frame in the world and [R_s | t_s] of the sensor in the rig. A step moves
// a frame, and a sensor that is free, as it moves a camera (cameras/pose.hpp). To first order the
// camera then moves by
//   δR_i = R_sᵀ δR_f + δR_s,   δc_i = δc_f − R_f [t_s]× δR_f + R_f δt_s,
// and its Jacobian by the two is that by its pose times this. All cameras of a frame have the same
// six columns in the parameter map, and all cameras of a free sensor another six.
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/cameras/matrix34.hpp"
#include "sfmcpp/cameras/pose.hpp"
#include "sfmcpp/linear/observation_graph.hpp"
#include "sfmcpp/linear/parameter_map.hpp"

namespace sfmcpp::ba {

// The pose of a sensor in its rig, of the sensors of a problem or a state.
PoseMatrixView sensor_at(std::span<const double> sensors, int s);

// Throws InvalidArgument for rigs whose arrays or numbers break a rule, for cameras that are not
// where their frame and sensor put them, and for frames that are fixed in part.
void check_rigs(const Problem& problem);

// The first of the six columns of a sensor in a camera block: after the pose and what is free of
// the intrinsics; kNoColumn if no sensor is free.
int sensor_column(const Problem& problem, std::size_t num_free_intrinsics);

// The derivative of a camera's pose by those of its frame and of its sensor.
class FrameMotion {
 public:
  // `sensor_column` as above.
  FrameMotion(const PoseMatrix& frame, const PoseMatrix& sensor, int sensor_column);

  // From derivatives by the pose of the camera, the first columns of rows of `width` numbers, to
  // those by the frame in their place and by the sensor in its columns.
  void carry(double* jacobian, long rows, int width) const;
  // From a step of frame and sensor, in the columns of a block, to the camera's, in place.
  void move(double* delta) const;
  // The second derivatives of the camera's turn and centre along such a step, in its axes.
  Eigen::Vector<double, 6> bend(const double* delta) const;

 private:
  Eigen::Matrix3d axes_;      // R_f
  Eigen::Matrix3d turned_;    // R_sᵀ
  Eigen::Matrix3d leverage_;  // −R_f [t_s]×
  Eigen::Vector3d arm_;       // R_sᵀ t_s
  int sensor_column_;
};

// Frames of a problem; without rigs each camera is its own.
class Frames {
 public:
  // The problem must outlive this object. Without the column of sensors, motions are of frames
  // alone.
  explicit Frames(const Problem& problem, int sensor_column = linear::kNoColumn);

  bool any() const { return !lead_.empty(); }
  // The first camera of its frame, which speaks for all.
  int lead(int camera) const { return any() ? lead_[camera] : camera; }
  bool leads(int camera) const { return lead(camera) == camera; }
  // How many cameras the frame of a camera has.
  int size(int camera) const { return any() ? size_[lead_[camera]] : 1; }

  PoseMatrix pose(const optim::State& state, int camera) const;
  FrameMotion motion(const optim::State& state, int camera) const;
  // Moves a camera by a step of its block: with its frame, and with its sensor, which `result` has
  // where `state` has it or where another camera has moved it.
  void plus(const optim::State& state, int camera, const double* delta, optim::State& result) const;

  // Marks as held the cameras without observations whose frame takes part by another.
  void hold_cameras(linear::ObservationGraph& graph) const;

 private:
  PoseMatrix sensor(const optim::State& state, int camera) const;

  const Problem& problem_;
  int sensor_column_;
  std::vector<int> lead_;
  std::vector<int> size_;  // of the frame, at its lead
};

// Which sensors of rigs are estimated.
//
// Frames and sensors are known up to a motion of each rig against its frames: of the sensors that
// frames hold together one must stay where it is, unless the poses of all these frames are fixed. A
// sensor without observations stays, too. So a sensor that is free by the problem may stay.
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
  std::vector<int> anchor_;    // of each sensor, the first of its rig that stays
  std::vector<int> of_frame_;  // of each frame, the first of its sensors that sees something there
};

}  // namespace sfmcpp::ba

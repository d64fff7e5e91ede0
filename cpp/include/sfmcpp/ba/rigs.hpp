// Rigs: cameras that move together, each a sensor of a rigid frame.
//
// Camera i, sensor s of frame f, is where both put it: R_i = R_f R_s, c_i = c_f + R_f t_s, with the
// pose [R_f | c_f] of the frame in the world and [R_s | t_s] of the sensor in the rig. A step moves
// a frame as it moves a camera (cameras/pose.hpp). To first order the camera then moves by
//   δR_i = R_sᵀ δR,   δc_i = δc − R_f [t_s]× δR,
// and its Jacobian by the frame is that by its pose times this. All cameras of a frame have the
// same six columns in the parameter map.
#pragma once

#include <vector>

#include <Eigen/Core>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/cameras/pose.hpp"
#include "sfmcpp/linear/observation_graph.hpp"

namespace sfmcpp::ba {

using PoseMatrix = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;

// Throws InvalidArgument for rigs whose arrays or numbers break a rule, for cameras that are not
// where their frame and sensor put them, and for frames that are fixed in part.
void check_rigs(const Problem& problem);

// How a camera answers to a step of its frame.
class FrameMotion {
 public:
  FrameMotion(const PoseMatrix& frame, const PoseMatrix& sensor);

  // From derivatives by the pose of the camera to those by the frame: the first columns of rows of
  // `width` numbers.
  void carry(double* jacobian, long rows, int width) const;
  // From a step of the frame to the camera's, in place.
  void move(double* delta) const;
  // The second derivative of the camera's centre along a step of the camera, in its axes.
  Eigen::Vector3d bend(const double* delta) const;

 private:
  Eigen::Matrix3d turned_;    // R_sᵀ
  Eigen::Matrix3d leverage_;  // −R_f [t_s]×
  Eigen::Vector3d arm_;       // R_sᵀ t_s
};

// Frames of a problem; without rigs each camera is its own.
class Frames {
 public:
  // The problem must outlive this object.
  explicit Frames(const Problem& problem);

  bool any() const { return !lead_.empty(); }
  // The first camera of its frame, which speaks for all.
  int lead(int camera) const { return any() ? lead_[camera] : camera; }
  bool leads(int camera) const { return lead(camera) == camera; }
  // How many cameras the frame of a camera has.
  int size(int camera) const { return any() ? size_[lead_[camera]] : 1; }

  PoseMatrix pose(const optim::State& state, int camera) const;
  PoseMatrix sensor(int camera) const;
  FrameMotion motion(const optim::State& state, int camera) const;
  // Moves a camera with its frame.
  void plus(const optim::State& state, int camera, const double* delta, double* result) const;

  // Marks as held the cameras without observations whose frame takes part by another.
  void hold_cameras(linear::ObservationGraph& graph) const;

 private:
  const Problem& problem_;
  std::vector<int> lead_;
  std::vector<int> size_;  // of the frame, at its lead
};

}  // namespace sfmcpp::ba

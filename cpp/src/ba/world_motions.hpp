// Derivatives of points and poses by a similarity of the world close to the identity: rotation ω,
// translation v, growth s. A point X moves by ω × X + v + s X, and a camera turns by Rᵀω in its own
// frame.
#pragma once

#include <Eigen/Core>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/ba/rigs.hpp"
#include "sfmcpp/cameras/pose.hpp"
#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/linear/parameter_map.hpp"

namespace sfmcpp::ba {

inline constexpr int kSimilarities = 7;
// A row for each coordinate or pose parameter, a column for each of ω, v, s.
using PointMotion = Eigen::Matrix<double, 3, kSimilarities>;
using PoseMotion = Eigen::Matrix<double, kPoseTangent, kSimilarities>;

PointMotion motion_of_point(const Eigen::Vector3d& x);
PoseMotion motion_of_pose(const PoseMatrix& pose);

// In units of the scene: the middle of its cameras is the origin, its extent one.
class WorldMotions {
 public:
  // Metric cameras. Problem, graph and state must outlive this object.
  WorldMotions(const Problem& problem,
               const linear::ObservationGraph& graph,
               const optim::State& state);

  const Frames& frames() const { return frames_; }
  const FreeSensors& sensors() const { return sensors_; }
  double extent() const { return extent_; }

  PointMotion of_point(int p) const;
  PoseMotion of_camera(int i) const;
  // Of the frame of a camera, whose rig grows with the world.
  PoseMotion of_frame(int i) const;
  // From where its rig grows to the sensor of a camera, in the rig.
  Eigen::Vector3d lever(int i) const;

 private:
  PoseMatrix camera(int i) const;
  Eigen::Vector3d scaled(const Eigen::Vector3d& x) const { return (x - middle_) / extent_; }
  PoseMotion of_pose(PoseMatrix pose) const;

  const Problem& problem_;
  const optim::State& state_;
  Frames frames_;
  FreeSensors sensors_;
  Eigen::Vector3d middle_ = Eigen::Vector3d::Zero();
  double extent_ = 0.0;
};

// Camera modes (linear/normal_equations.hpp): motions of a neighbourhood of cameras as a whole.

// The seven similarities and each free intrinsic parameter; none for projective cameras.
void set_camera_modes(const Problem& problem,
                      const linear::ParameterMap& map,
                      const optim::State& state,
                      linear::CameraModes& modes);

}  // namespace sfmcpp::ba

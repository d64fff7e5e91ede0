// The frame of a projective world in which a solve works.
//
// Images do not change when every point goes to H Q and every camera to P H⁻¹, but damping and step
// lengths do: with points (X, 1) of norm one, X of the size of a scene fills the sphere and the
// step is far from linear. In the frame used here the points lie close to (0, 0, 0, 1), where
// moving on the sphere is moving X; on the thesis' circle scene (σ_Q = 1 m, σ_t = 2 m, σ_R = 15°)
// Levenberg–Marquardt then takes 6 iterations, in metres 28, and all runs converge instead of seven
// in ten.
#pragma once

#include <Eigen/Core>

#include "sfmcpp/core/exchange.hpp"
#include "sfmcpp/optim/state.hpp"

namespace sfmcpp::ba {

class WorldFrame {
 public:
  // H = (s (X − m), 1): m the median of the points in each coordinate, s such that their median
  // distance to m becomes kRadius. The points are those of all ranks.
  explicit WorldFrame(const optim::State& state, Exchange& exchange = this_process());

  // Both keep the scale of every homogeneous block.
  void enter(optim::State& state) const { transform(state, to_frame_, from_frame_); }
  void leave(optim::State& state) const { transform(state, from_frame_, to_frame_); }

 private:
  static constexpr double kRadius = 0.1;
  static void transform(optim::State& state,
                        const Eigen::Matrix4d& points,
                        const Eigen::Matrix4d& cameras);

  Eigen::Matrix4d to_frame_ = Eigen::Matrix4d::Identity();
  Eigen::Matrix4d from_frame_ = Eigen::Matrix4d::Identity();
};

}  // namespace sfmcpp::ba

#include "sfmcpp/ba/rigs.hpp"

#include <array>

#include <gtest/gtest.h>

#include "sfmcpp/math/so3.hpp"

namespace sfmcpp::ba {
namespace {

using Delta = Eigen::Matrix<double, 6, 1>;
using Poses = Eigen::Matrix<double, 2, 12, Eigen::RowMajor>;

PoseMatrix pose_of(const Eigen::Vector3d& turn, const Eigen::Vector3d& place) {
  PoseMatrix pose;
  pose << exp_so3(turn), place;
  return pose;
}

Eigen::Map<Eigen::RowVectorXd> row(PoseMatrix& pose) { return {pose.data(), 12}; }

// One frame of two sensors, neither at its origin.
class RigTest : public testing::Test {
 protected:
  RigTest() {
    const PoseMatrix frame = pose_of({0.3, -0.2, 0.9}, {4.0, -2.0, 1.0});
    for (int k = 0; k < 2; ++k) {
      PoseMatrix sensor = pose_of({0.1, 1.3 * k, -0.4}, {0.5 - k, 0.2, 0.3});
      PoseMatrix camera;
      camera << frame.leftCols<3>() * sensor.leftCols<3>(),
          frame.leftCols<3>() * sensor.col(3) + frame.col(3);
      sensors.row(k) = row(sensor);
      cameras.row(k) = row(camera);
    }
    problem.cameras = {cameras.data(), 24};
    problem.rigs = {{sensors.data(), 24}, numbers.frame, numbers.sensor};
    state.cameras.assign(cameras.data(), cameras.data() + 24);
  }

  // Camera 1 moved by its frame, as a step of the camera.
  Delta moved(const Delta& by_frame) const {
    PoseMatrix after;
    Frames(problem).plus(state, 1, by_frame.data(), after.data());
    const Eigen::Map<const PoseMatrix> before(state.cameras.data() + 12);
    Delta step;
    step << log_so3(before.leftCols<3>().transpose() * after.leftCols<3>()),
        after.col(3) - before.col(3);
    return step;
  }

  struct {
    std::array<int, 2> frame{0, 0}, sensor{0, 1};
  } numbers;
  Poses sensors, cameras;
  Problem problem;
  optim::State state;
};

TEST_F(RigTest, AStepOfTheFrameMovesTheCameraByTheDerivative) {
  const FrameMotion motion = Frames(problem).motion(state, 1);
  constexpr double h = 1e-4;
  Eigen::Matrix<double, 6, 6, Eigen::RowMajor> carried =
      Eigen::Matrix<double, 6, 6, Eigen::RowMajor>::Identity();
  motion.carry(carried.data(), 6, 6);
  for (int k = 0; k < 6; ++k) {
    const Delta numeric = (moved(h * Delta::Unit(k)) - moved(-h * Delta::Unit(k))) / (2.0 * h);
    Delta derivative = Delta::Unit(k);
    motion.move(derivative.data());
    EXPECT_LT((derivative - numeric).norm(), 1e-7) << "column " << k;
    EXPECT_LT((carried.col(k) - numeric).norm(), 1e-7) << "column " << k;
  }
}

TEST_F(RigTest, TheCentreBendsAsTheSecondDifferenceSays) {
  Delta step;
  step << 0.4, -0.7, 0.2, 1.0, 2.0, -0.5;
  constexpr double h = 1e-3;
  const Eigen::Matrix3d turned =
      Eigen::Map<const PoseMatrix>(state.cameras.data() + 12).leftCols<3>();
  const Eigen::Vector3d numeric = (moved(h * step) + moved(-h * step)).tail<3>() / (h * h);
  const FrameMotion motion = Frames(problem).motion(state, 1);
  motion.move(step.data());
  EXPECT_GT(numeric.norm(), 0.1);
  EXPECT_LT((turned * motion.bend(step.data()) - numeric).norm(), 1e-6);
}

}  // namespace
}  // namespace sfmcpp::ba

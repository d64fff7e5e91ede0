#include "sfmcpp/ba/rigs.hpp"

#include <algorithm>
#include <array>

#include <gtest/gtest.h>

#include "sfmcpp/math/so3.hpp"

namespace sfmcpp::ba::rigs_test {
namespace {

using Delta = Eigen::Matrix<double, 6, 1>;
using Block = Eigen::Matrix<double, 12, 1>;  // a step of the frame, and one of the sensor
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
    problem.rigs = {{sensors.data(), 24}, numbers.frame, numbers.sensor, numbers.free};
    state.cameras.assign(cameras.data(), cameras.data() + 24);
    state.sensors.assign(sensors.data(), sensors.data() + 24);
  }

  Frames frames() const { return Frames(problem, 6); }

  // Camera 1 moved by its frame and sensor, as a step of the camera.
  Delta moved(const Block& block) const {
    optim::State result = state;
    frames().plus(state, 1, block.data(), result);
    const PoseMatrixView before(state.cameras.data() + 12), after(result.cameras.data() + 12);
    Delta step;
    step << log_so3(before.leftCols<3>().transpose() * after.leftCols<3>()),
        after.col(3) - before.col(3);
    return step;
  }

  struct {
    std::array<int, 2> frame{0, 0}, sensor{0, 1};
    std::array<std::uint8_t, 2> free{0, 1};
  } numbers;
  Poses sensors, cameras;
  Problem problem;
  optim::State state;
};

TEST_F(RigTest, AStepOfFrameAndSensorMovesTheCameraByTheDerivative) {
  const FrameMotion motion = frames().motion(state, 1);
  constexpr double h = 1e-4;
  Eigen::Matrix<double, 6, 12, Eigen::RowMajor> carried =
      Eigen::Matrix<double, 6, 12, Eigen::RowMajor>::Identity();
  motion.carry(carried.data(), 6, 12);
  for (int k = 0; k < 12; ++k) {
    const Delta numeric = (moved(h * Block::Unit(k)) - moved(-h * Block::Unit(k))) / (2.0 * h);
    Block derivative = Block::Unit(k);
    motion.move(derivative.data());
    EXPECT_LT((derivative.head<6>() - numeric).norm(), 1e-7) << "column " << k;
    EXPECT_LT((carried.col(k) - numeric).norm(), 1e-7) << "column " << k;
  }
}

TEST_F(RigTest, AnyEntryBeyondZeroFreesASensor) {
  numbers.free = {0, 255};
  EXPECT_TRUE(problem.rigs.any_free());
  numbers.free = {0, 0};
  EXPECT_FALSE(problem.rigs.any_free());
}

TEST_F(RigTest, TheCameraBendsAsTheSecondDifferenceSays) {
  Block step;
  step << 0.4, -0.7, 0.2, 1.0, 2.0, -0.5, -0.3, 0.5, 0.6, 0.8, -0.4, 0.2;
  constexpr double h = 1e-3;
  const Eigen::Matrix3d axes = PoseMatrixView(state.cameras.data() + 12).leftCols<3>();
  const Delta numeric = (moved(h * step) + moved(-h * step)) / (h * h);
  Delta bend = frames().motion(state, 1).bend(step.data());
  bend.tail<3>() = (axes * bend.tail<3>()).eval();
  EXPECT_GT(numeric.head<3>().norm(), 0.1);
  EXPECT_GT(numeric.tail<3>().norm(), 0.1);
  EXPECT_LT((bend - numeric).norm(), 1e-5);
}

TEST_F(RigTest, ASensorMovesOnceForAllItsCamerasAndTheOtherStays) {
  optim::State result = state;
  Block step = Block::Zero();
  step[7] = 0.1;
  step[11] = 0.2;
  frames().plus(state, 1, step.data(), result);
  EXPECT_TRUE(std::equal(result.sensors.begin(), result.sensors.begin() + 12, sensors.data()));
  const PoseMatrix before = sensor_at(state.sensors, 1), after = sensor_at(result.sensors, 1);
  EXPECT_NEAR((after - before).col(3).z(), 0.2, 1e-12);
  EXPECT_NEAR(log_so3(before.leftCols<3>().transpose() * after.leftCols<3>()).y(), 0.1, 1e-12);
}

}  // namespace
}  // namespace sfmcpp::ba::rigs_test

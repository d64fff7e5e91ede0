#include "sfmcpp/ba/rigs.hpp"

#include <algorithm>
#include <set>
#include <string>
#include <utility>

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "sfmcpp/core/error.hpp"
#include "sfmcpp/math/so3.hpp"

namespace sfmcpp::ba {
namespace {

using PoseView = Eigen::Map<const PoseMatrix>;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// How far a camera may be from where frame and sensor put it: of a rotation, of the distances
// within the rig, of the distance to the origin of the world.
constexpr double kLooseTurn = 1e-6, kLooseOffset = 1e-6, kLooseCentre = 1e-9;

constexpr int kNone = -1;

PoseMatrix composed(const PoseMatrix& frame, const PoseMatrix& sensor) {
  PoseMatrix camera;
  camera.leftCols<3>() = frame.leftCols<3>() * sensor.leftCols<3>();
  camera.col(3) = frame.col(3) + frame.leftCols<3>() * sensor.col(3);
  return camera;
}

PoseMatrix frame_of(const PoseMatrix& camera, const PoseMatrix& sensor) {
  PoseMatrix frame;
  frame.leftCols<3>() = camera.leftCols<3>() * sensor.leftCols<3>().transpose();
  frame.col(3) = camera.col(3) - frame.leftCols<3>() * sensor.col(3);
  return frame;
}

[[noreturn]] void refuse(const std::string& what, const std::string& rule) {
  throw InvalidArgument("rigs." + what + ": " + rule);
}

std::string entry(const char* array, long k) {
  return std::string(array) + "[" + std::to_string(k) + "]";
}

long num_sensors(const Rigs& rigs) {
  return static_cast<long>(rigs.sensors.size()) / kCameraStorage;
}

void check_lengths(const Problem& problem) {
  const Rigs& rigs = problem.rigs;
  const auto cameras = static_cast<std::size_t>(problem.num_cameras());
  const auto check = [&](const char* array, std::size_t size) {
    if (size != cameras)
      refuse(array,
             std::to_string(size) + " values for " + std::to_string(cameras) +
                 " cameras, must be one for each");
  };
  check("frame_of_camera", rigs.frame_of_camera.size());
  check("sensor_of_camera", rigs.sensor_of_camera.size());
  if (!is_metric(problem.camera_model))
    refuse("frame_of_camera", "camera_model 'projective' has no poses, its cameras form no rig");
}

void check_numbers(const Problem& problem) {
  const Rigs& rigs = problem.rigs;
  const auto check = [](const char* array, std::span<const int> values, long end) {
    for (std::size_t k = 0; k < values.size(); ++k) {
      if (values[k] < 0 || values[k] >= end)
        refuse(entry(array, static_cast<long>(k)) + " = " + std::to_string(values[k]),
               "must be in [0, " + std::to_string(end) + ")");
    }
  };
  check("frame_of_camera", rigs.frame_of_camera, problem.num_cameras());
  check("sensor_of_camera", rigs.sensor_of_camera, num_sensors(rigs));
  std::set<std::pair<int, int>> seen;
  for (int i = 0; i < problem.num_cameras(); ++i) {
    const int frame = rigs.frame_of_camera[i], sensor = rigs.sensor_of_camera[i];
    if (!seen.emplace(frame, sensor).second)
      refuse(entry("sensor_of_camera", i) + " = " + std::to_string(sensor),
             "frame " + std::to_string(frame) + " has a camera of this sensor already");
  }
}

void check_sensors(const Rigs& rigs) {
  for (long s = 0; s < num_sensors(rigs); ++s) {
    const PoseView sensor(rigs.sensors.data() + kCameraStorage * s);
    if (!sensor.allFinite()) refuse(entry("sensors", s), "must be finite");
    if (!is_rotation(sensor.leftCols<3>()))
      refuse(entry("sensors", s), "not a rotation: must be orthonormal to 1e-6 with determinant 1");
  }
}

void check_camera(const Problem& problem, const Frames& frames, int i) {
  const int lead = frames.lead(i);
  const std::string name = entry("cameras", i);
  if (problem.is_fixed_camera(i) != problem.is_fixed_camera(lead))
    throw InvalidArgument("fixed_" + name + ": differs from that of camera " +
                          std::to_string(lead) + " in the same frame: must be the same");
  const auto camera = [&](int k) {
    return PoseView(problem.cameras.data() + problem.camera_offset(k));
  };
  const PoseMatrix sensor = frames.sensor(i), of_lead = frames.sensor(lead);
  const PoseMatrix wanted = composed(frame_of(camera(lead), of_lead), sensor);
  const double turn = (wanted - camera(i)).leftCols<3>().cwiseAbs().maxCoeff();
  const double off = (wanted - camera(i)).col(3).norm();
  const double loose = kLooseOffset * (sensor.col(3) - of_lead.col(3)).norm() +
                       kLooseCentre * (camera(i).col(3).norm() + camera(lead).col(3).norm());
  if (turn <= kLooseTurn && off <= loose) return;
  throw InvalidArgument(name + ": " + std::to_string(off) + " and " + std::to_string(turn) +
                        " rad from where its frame and sensor " +
                        std::to_string(problem.rigs.sensor_of_camera[i]) +
                        " put it: must agree with camera " + std::to_string(lead) +
                        " of the same frame (problem.rigs.rigid(cameras) gives poses that do)");
}

}  // namespace

void check_rigs(const Problem& problem) {
  if (problem.rigs.empty()) return;
  check_lengths(problem);
  check_numbers(problem);
  check_sensors(problem.rigs);
  const Frames frames(problem);
  for (int i = 0; i < problem.num_cameras(); ++i) check_camera(problem, frames, i);
}

FrameMotion::FrameMotion(const PoseMatrix& frame, const PoseMatrix& sensor)
    : turned_(sensor.leftCols<3>().transpose()),
      leverage_(-frame.leftCols<3>() * skew(sensor.col(3))),
      arm_(turned_ * sensor.col(3)) {}

void FrameMotion::carry(double* jacobian, long rows, int width) const {
  Eigen::Map<RowMajor> by(jacobian, rows, width);
  for (long row = 0; row < rows; ++row) {
    const Eigen::RowVector3d turn = by.row(row).head<3>(), centre = by.row(row).segment<3>(3);
    by.row(row).head<3>() = turn * turned_ + centre * leverage_;
  }
}

void FrameMotion::move(double* delta) const {
  Eigen::Map<Eigen::Vector3d> turn(delta), centre(delta + 3);
  centre += leverage_ * turn;
  turn = (turned_ * turn).eval();
}

Eigen::Vector3d FrameMotion::bend(const double* delta) const {
  const Eigen::Map<const Eigen::Vector3d> turn(delta);
  return turn.cross(turn.cross(arm_));
}

Frames::Frames(const Problem& problem) : problem_(problem) {
  if (problem.rigs.empty()) return;
  const auto count = static_cast<std::size_t>(problem.num_cameras());
  std::vector<int> first(count, kNone);
  size_.assign(count, 0);
  for (int i = 0; i < problem.num_cameras(); ++i) {
    int& lead = first[problem.rigs.frame_of_camera[i]];
    if (lead == kNone) lead = i;
    lead_.push_back(lead);
    ++size_[lead];
  }
}

PoseMatrix Frames::sensor(int camera) const {
  return PoseView(problem_.rigs.sensors.data() +
                  kCameraStorage * problem_.rigs.sensor_of_camera[camera]);
}

PoseMatrix Frames::pose(const optim::State& state, int camera) const {
  const PoseView stored(state.cameras.data() + problem_.camera_offset(lead(camera)));
  return any() ? frame_of(stored, sensor(lead(camera))) : PoseMatrix(stored);
}

FrameMotion Frames::motion(const optim::State& state, int camera) const {
  return {pose(state, camera), sensor(camera)};
}

void Frames::plus(const optim::State& state,
                  int camera,
                  const double* delta,
                  double* result) const {
  PoseMatrix frame = pose(state, camera);
  plus_pose(frame.data(), delta, frame.data());
  Eigen::Map<PoseMatrix>{result} = composed(frame, sensor(camera));
}

void Frames::hold_cameras(linear::ObservationGraph& graph) const {
  if (!any()) return;
  std::vector<std::uint8_t> frame_takes_part(lead_.size(), 0);
  for (int i = 0; i < graph.num_cameras; ++i) frame_takes_part[lead_[i]] |= graph.takes_part(i);
  graph.held.resize(lead_.size());
  for (int i = 0; i < graph.num_cameras; ++i) graph.held[i] = frame_takes_part[lead_[i]];
}

}  // namespace sfmcpp::ba

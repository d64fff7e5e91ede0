#include "sfmcpp/ba/rigs.hpp"

#include <algorithm>
#include <set>
#include <string>
#include <utility>

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "sfmcpp/core/error.hpp"
#include "sfmcpp/core/grouping.hpp"
#include "sfmcpp/math/so3.hpp"

namespace sfmcpp::ba {
namespace {

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

[[noreturn]] void refuse_rigs(const std::string& what, const std::string& rule) {
  refuse("rigs." + what, rule);
}

std::size_t sensor_offset(int s) { return kCameraStorage * static_cast<std::size_t>(s); }

bool moves(const double* pose_step) {
  return std::any_of(pose_step, pose_step + kPoseTangent, [](double d) { return d != 0.0; });
}

void check_lengths(const Problem& problem) {
  const Rigs& rigs = problem.rigs;
  const auto cameras = static_cast<std::size_t>(problem.num_cameras());
  const auto check = [&](const char* array, std::size_t size) {
    if (size != cameras)
      refuse_rigs(array,
                  std::to_string(size) + " values for " + std::to_string(cameras) +
                      " cameras, must be one for each");
  };
  check("frame_of_camera", rigs.frame_of_camera.size());
  check("sensor_of_camera", rigs.sensor_of_camera.size());
  if (!rigs.free_sensors.empty() && std::ssize(rigs.free_sensors) != rigs.num_sensors())
    refuse_rigs("free_sensors",
                std::to_string(rigs.free_sensors.size()) + " values for " +
                    std::to_string(rigs.num_sensors()) + " sensors, must be one for each or none");
  if (!is_metric(problem.camera_model))
    refuse_rigs("frame_of_camera",
                "camera_model 'projective' has no poses, its cameras form no rig");
}

void check_numbers(const Problem& problem) {
  const Rigs& rigs = problem.rigs;
  const auto check = [](const char* array, std::span<const int> values, long end) {
    for (std::size_t k = 0; k < values.size(); ++k) {
      if (values[k] < 0 || values[k] >= end)
        refuse_rigs(entry(array, k) + " = " + std::to_string(values[k]),
                    "must be in [0, " + std::to_string(end) + ")");
    }
  };
  check("frame_of_camera", rigs.frame_of_camera, problem.num_cameras());
  check("sensor_of_camera", rigs.sensor_of_camera, rigs.num_sensors());
  std::set<std::pair<int, int>> seen;
  for (int i = 0; i < problem.num_cameras(); ++i) {
    const int frame = rigs.frame_of_camera[i], sensor = rigs.sensor_of_camera[i];
    if (!seen.emplace(frame, sensor).second)
      refuse_rigs(entry("sensor_of_camera", i) + " = " + std::to_string(sensor),
                  "frame " + std::to_string(frame) + " has a camera of this sensor already");
  }
}

void check_sensors(const Rigs& rigs) {
  for (int s = 0; s < rigs.num_sensors(); ++s) {
    const PoseMatrixView sensor = sensor_at(rigs.sensors, s);
    if (!sensor.allFinite()) refuse_rigs(entry("sensors", s), "must be finite");
    if (!is_rotation(sensor.leftCols<3>()))
      refuse_rigs(entry("sensors", s),
                  "not a rotation: must be orthonormal to 1e-6 with determinant 1");
  }
}

void check_camera(const Problem& problem, const Frames& frames, int i) {
  const int lead = frames.lead(i);
  const std::string name = entry("cameras", i);
  if (problem.is_fixed_camera(i) != problem.is_fixed_camera(lead))
    throw InvalidArgument("fixed_" + name + ": differs from that of camera " +
                          std::to_string(lead) + " in the same frame: must be the same");
  const auto camera = [&](int k) {
    return PoseMatrixView(problem.cameras.data() + problem.camera_offset(k));
  };
  const auto sensor_of = [&](int k) {
    return PoseMatrix(sensor_at(problem.rigs.sensors, problem.rigs.sensor_of_camera[k]));
  };
  const PoseMatrix sensor = sensor_of(i), of_lead = sensor_of(lead);
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

PoseMatrixView sensor_at(std::span<const double> sensors, int s) {
  return PoseMatrixView(sensors.data() + sensor_offset(s));
}

void check_rigs(const Problem& problem) {
  if (problem.rigs.empty()) return;
  check_lengths(problem);
  check_numbers(problem);
  check_sensors(problem.rigs);
  const Frames frames(problem);
  for (int i = 0; i < problem.num_cameras(); ++i) check_camera(problem, frames, i);
}

int sensor_column(const Problem& problem, std::size_t num_free_intrinsics) {
  if (!problem.rigs.any_free()) return linear::kNoColumn;
  return kPoseTangent + static_cast<int>(num_free_intrinsics);
}

FrameMotion::FrameMotion(const PoseMatrix& frame, const PoseMatrix& sensor, int sensor_column)
    : axes_(frame.leftCols<3>()),
      turned_(sensor.leftCols<3>().transpose()),
      leverage_(-axes_ * skew(sensor.col(3))),
      arm_(turned_ * sensor.col(3)),
      sensor_column_(sensor_column) {}

void FrameMotion::carry(double* jacobian, long rows, int width) const {
  Eigen::Map<RowMajor> by(jacobian, rows, width);
  for (long row = 0; row < rows; ++row) {
    const Eigen::RowVector3d turn = by.row(row).head<3>(), centre = by.row(row).segment<3>(3);
    by.row(row).head<3>() = turn * turned_ + centre * leverage_;
    if (sensor_column_ == linear::kNoColumn) continue;
    by.row(row).segment<3>(sensor_column_) = turn;
    by.row(row).segment<3>(sensor_column_ + 3) = centre * axes_;
  }
}

void FrameMotion::move(double* delta) const {
  Eigen::Map<Eigen::Vector3d> turn(delta), centre(delta + 3);
  centre += leverage_ * turn;
  turn = (turned_ * turn).eval();
  if (sensor_column_ == linear::kNoColumn) return;
  const Eigen::Map<const Eigen::Vector3d> own_turn(delta + sensor_column_),
      own_shift(delta + sensor_column_ + 3);
  centre += axes_ * own_shift;
  turn += own_turn;
}

// The turn is log(exp([α a]×) exp([α b]×)) = α (a + b) + ½ α² a × b + …, with a of the frame and b
// of the sensor.
Eigen::Vector<double, 6> FrameMotion::bend(const double* delta) const {
  const Eigen::Vector3d turn = turned_ * Eigen::Map<const Eigen::Vector3d>(delta);
  Eigen::Vector3d own_turn = Eigen::Vector3d::Zero(), own_shift = Eigen::Vector3d::Zero();
  if (sensor_column_ != linear::kNoColumn) {
    own_turn = Eigen::Map<const Eigen::Vector3d>(delta + sensor_column_);
    own_shift = turned_ * Eigen::Map<const Eigen::Vector3d>(delta + sensor_column_ + 3);
  }
  Eigen::Vector<double, 6> result;
  result << turn.cross(own_turn), turn.cross(turn.cross(arm_) + 2.0 * own_shift);
  return result;
}

Frames::Frames(const Problem& problem, int sensor_column)
    : problem_(problem), sensor_column_(sensor_column) {
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

PoseMatrix Frames::sensor(const optim::State& state, int camera) const {
  return sensor_at(state.sensors, problem_.rigs.sensor_of_camera[camera]);
}

PoseMatrix Frames::pose(const optim::State& state, int camera) const {
  const PoseMatrixView stored(state.cameras.data() + problem_.camera_offset(lead(camera)));
  return any() ? frame_of(stored, sensor(state, lead(camera))) : PoseMatrix(stored);
}

FrameMotion Frames::motion(const optim::State& state, int camera) const {
  return {pose(state, camera), sensor(state, camera), sensor_column_};
}

void Frames::plus(const optim::State& state,
                  int camera,
                  const double* delta,
                  optim::State& result) const {
  const std::size_t place = problem_.camera_offset(camera);
  const bool own_moves = sensor_column_ != linear::kNoColumn && moves(delta + sensor_column_);
  if (!own_moves && !moves(delta)) {
    std::copy_n(state.cameras.data() + place, kCameraStorage, result.cameras.data() + place);
    return;
  }
  PoseMatrix frame = pose(state, camera), own = sensor(state, camera);
  plus_pose(frame.data(), delta, frame.data());
  if (own_moves) {
    plus_pose(own.data(), delta + sensor_column_, own.data());
    // Cameras of one sensor set it to the same values.
    const int s = problem_.rigs.sensor_of_camera[camera];
    std::copy_n(own.data(), kCameraStorage, result.sensors.data() + sensor_offset(s));
  }
  Eigen::Map<PoseMatrix>{result.cameras.data() + place} = composed(frame, own);
}

void Frames::hold_cameras(linear::ObservationGraph& graph) const {
  if (!any()) return;
  std::vector<std::uint8_t> frame_takes_part(lead_.size(), 0);
  for (int i = 0; i < graph.num_cameras; ++i) frame_takes_part[lead_[i]] |= graph.takes_part(i);
  graph.held.resize(lead_.size());
  for (int i = 0; i < graph.num_cameras; ++i) graph.held[i] = frame_takes_part[lead_[i]];
}

namespace {

constexpr int kNoSensor = -1;

// Of each frame, the first of its sensors with observations there.
std::vector<int> sensors_of_frames(const Problem& problem, const linear::ObservationGraph& graph) {
  std::vector<int> of_frame(problem.num_cameras(), kNoSensor);
  for (int i = 0; i < problem.num_cameras(); ++i) {
    int& first = of_frame[problem.rigs.frame_of_camera[i]];
    if (graph.is_observed(i) && first == kNoSensor) first = problem.rigs.sensor_of_camera[i];
  }
  return of_frame;
}

// Sensors that frames hold together by what they see.
DisjointSets joined_sensors(const Problem& problem,
                            const linear::ObservationGraph& graph,
                            const std::vector<int>& of_frame) {
  DisjointSets rigs(problem.rigs.num_sensors());
  for (int i = 0; i < problem.num_cameras(); ++i) {
    if (graph.is_observed(i))
      rigs.join(problem.rigs.sensor_of_camera[i], of_frame[problem.rigs.frame_of_camera[i]]);
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
  of_frame_ = sensors_of_frames(problem, graph);
  DisjointSets rigs = joined_sensors(problem, graph, of_frame_);
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
  const int seeing = of_frame_[problem_.rigs.frame_of_camera[camera]];
  return frames.pose(state, camera).leftCols<3>() *
         anchor_in_rig(state,
                       seeing != kNoSensor ? seeing : problem_.rigs.sensor_of_camera[camera]);
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

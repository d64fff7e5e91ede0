#include "sfmcpp/ba/mask.hpp"

#include <algorithm>
#include <string>

#include "sfmcpp/ba/rigs.hpp"
#include "sfmcpp/cameras/pose.hpp"
#include "sfmcpp/core/error.hpp"

namespace sfmcpp::ba {
namespace {

using linear::kNoColumn;
using linear::ObservationGraph;
using linear::ParameterMap;

// Hands out reduced columns, one variable block after the other.
class Builder {
 public:
  Builder(const Problem& problem,
          const ObservationGraph& graph,
          const std::vector<int>& intrinsics,
          const std::vector<PoseParameter>& gauge)
      : problem_(problem),
        graph_(graph),
        intrinsics_(intrinsics),
        gauge_(gauge),
        frames_(problem),
        tangent_(camera_tangent(problem.camera_model)),
        sensor_column_(sensor_column(problem, intrinsics.size())) {
    map_.camera_size = linear::padded_camera_size(used_columns());
    map_.column.assign(static_cast<std::size_t>(problem.num_cameras()) * map_.camera_size,
                       kNoColumn);
    users_.assign(problem.num_groups(), 0);
    for (int i = 0; i < problem.num_cameras(); ++i) {
      if (graph_.is_observed(i)) ++users_[problem.intrinsics_index[i]];
    }
  }

  ParameterMap build() {
    for (int i = 0; i < problem_.num_cameras(); ++i) {
      if (!graph_.takes_part(i)) continue;
      if (!problem_.is_fixed_camera(i)) add_pose(i);
      if (frames_.size(i) > 1) end_block();  // a block is shared as a whole or not at all
      if (graph_.is_observed(i) && users_[group(i)] == 1) add_intrinsics(group(i), {i});
      end_block();
    }
    add_shared_intrinsics();
    if (sensor_column_ != kNoColumn) add_sensors();
    map_.free_point.resize(problem_.num_points());
    for (int p = 0; p < problem_.num_points(); ++p) {
      map_.free_point[p] = !problem_.is_fixed_point(p) && graph_.observations_of_point(p) > 0;
    }
    map_.block_begin.push_back(map_.num_columns);
    map_.is_intrinsic.resize(map_.num_columns);
    return std::move(map_);
  }

 private:
  int used_columns() const {
    const int alone = tangent_ + static_cast<int>(intrinsics_.size());
    if (sensor_column_ == kNoColumn) return alone;
    constexpr int kMost = linear::kMaxCameraSize - 2 * kPoseTangent;
    if (std::ssize(intrinsics_) > kMost)
      throw InvalidArgument("rigs.free_sensors: " + std::to_string(intrinsics_.size()) +
                            " intrinsics are free beside sensors, must be at most " +
                            std::to_string(kMost));
    return alone + kPoseTangent;
  }
  int group(int camera) const { return problem_.intrinsics_index[camera]; }
  int& column(int camera, int k) {
    return map_.column[static_cast<std::size_t>(camera) * map_.camera_size + k];
  }

  // A frame has the pose columns of its lead, which comes before its other cameras.
  void add_pose(int camera) {
    const int lead = frames_.lead(camera);
    if (camera != lead) {
      for (int k = 0; k < tangent_; ++k) column(camera, k) = column(lead, k);
      map_.has_shared_columns = true;
      return;
    }
    for (int k = 0; k < tangent_; ++k) {
      if (!is_held({camera, k})) column(camera, k) = next_column_++;
    }
  }
  bool is_held(PoseParameter parameter) const {
    return std::binary_search(gauge_.begin(), gauge_.end(), parameter);
  }

  void add_intrinsics(int group, const std::vector<int>& cameras) {
    for (std::size_t k = 0; k < intrinsics_.size(); ++k) {
      if (problem_.is_fixed_intrinsic(problem_.row_offset(group) + intrinsics_[k])) continue;
      for (int camera : cameras) column(camera, tangent_ + static_cast<int>(k)) = next_column_;
      map_.is_intrinsic.resize(next_column_);
      map_.is_intrinsic.push_back(1);
      ++next_column_;
    }
  }

  void add_shared_intrinsics() {
    std::vector<std::vector<int>> cameras(users_.size());
    for (int i = 0; i < problem_.num_cameras(); ++i) {
      if (graph_.is_observed(i) && users_[group(i)] > 1) cameras[group(i)].push_back(i);
    }
    for (std::size_t g = 0; g < cameras.size(); ++g) {
      if (!cameras[g].empty()) add_intrinsics(static_cast<int>(g), cameras[g]);
      map_.has_shared_columns |= next_column_ > map_.num_columns;
      end_block();
    }
  }

  // Of all cameras of a sensor, those too whose frame takes no part: they stay in their places.
  void add_sensors() {
    const FreeSensors sensors(problem_, graph_);
    const std::vector<std::vector<int>> cameras = sensors.cameras();
    for (std::size_t s = 0; s < cameras.size(); ++s) {
      if (!sensors.moves(static_cast<int>(s))) continue;
      for (int k = 0; k < kPoseTangent; ++k) {
        if (is_held({cameras[s].front(), kPoseTangent + k})) continue;
        for (int camera : cameras[s]) column(camera, sensor_column_ + k) = next_column_;
        ++next_column_;
      }
      map_.has_shared_columns |= cameras[s].size() > 1;
      end_block();
    }
  }

  void end_block() {
    if (next_column_ == map_.num_columns) return;
    map_.block_begin.push_back(map_.num_columns);
    map_.block_of.resize(next_column_, static_cast<int>(map_.block_begin.size()) - 1);
    map_.num_columns = next_column_;
  }

  const Problem& problem_;
  const ObservationGraph& graph_;
  const std::vector<int>& intrinsics_;
  const std::vector<PoseParameter>& gauge_;
  Frames frames_;
  int tangent_;             // columns of a camera, intrinsics and sensor aside
  int sensor_column_;       // the first of its sensor, kNoColumn: none is free
  std::vector<int> users_;  // observed cameras of each row of intrinsics
  ParameterMap map_;
  int next_column_ = 0;
};

}  // namespace

std::vector<int> free_intrinsics(const Problem& problem, const ObservationGraph& graph) {
  std::vector<int> free;
  if (!has_free_intrinsics(problem.camera_model)) return free;
  for (int k = 0; k < problem.num_intrinsics(); ++k) {
    for (int i = 0; i < problem.num_cameras(); ++i) {
      const std::size_t parameter = problem.intrinsics_offset(i) + k;
      if (!graph.is_observed(i) || problem.is_fixed_intrinsic(parameter)) continue;
      free.push_back(k);
      break;
    }
  }
  return free;
}

ParameterMap make_parameter_map(const Problem& problem,
                                const ObservationGraph& graph,
                                const std::vector<int>& free_intrinsics,
                                const std::vector<PoseParameter>& gauge) {
  return Builder(problem, graph, free_intrinsics, gauge).build();
}

}  // namespace sfmcpp::ba

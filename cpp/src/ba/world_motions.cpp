#include "world_motions.hpp"

#include <algorithm>

#include "sfmcpp/math/so3.hpp"

namespace sfmcpp::ba {

PointMotion motion_of_point(const Eigen::Vector3d& x) {
  PointMotion rows;
  rows << -skew(x), Eigen::Matrix3d::Identity(), x;
  return rows;
}

PoseMotion motion_of_pose(const PoseMatrix& pose) {
  PoseMotion rows = PoseMotion::Zero();
  rows.topLeftCorner<3, 3>() = pose.leftCols<3>().transpose();
  rows.bottomRows<3>() = motion_of_point(pose.col(3));
  return rows;
}

WorldMotions::WorldMotions(const Problem& problem,
                           const linear::ObservationGraph& graph,
                           const optim::State& state)
    : problem_(problem), state_(state), frames_(problem), sensors_(problem, graph) {
  int count = 0;
  for (int i = 0; i < graph.num_cameras; ++i) {
    if (!graph.takes_part(i)) continue;
    middle_ += camera(i).col(3);
    ++count;
  }
  middle_ /= std::max(count, 1);
  for (int i = 0; i < graph.num_cameras; ++i) {
    if (graph.takes_part(i)) extent_ = std::max(extent_, (camera(i).col(3) - middle_).norm());
  }
  if (extent_ == 0.0) extent_ = 1.0;
}

PoseMatrix WorldMotions::camera(int i) const {
  return PoseMatrixView(state_.cameras.data() + problem_.camera_offset(i));
}

PoseMotion WorldMotions::of_pose(PoseMatrix pose) const {
  pose.col(3) = scaled(pose.col(3));
  return motion_of_pose(pose);
}

PointMotion WorldMotions::of_point(int p) const {
  return motion_of_point(
      scaled(Eigen::Map<const Eigen::Vector3d>(state_.points.data() + problem_.point_offset(p))));
}

PoseMotion WorldMotions::of_camera(int i) const { return of_pose(camera(i)); }

PoseMotion WorldMotions::of_frame(int i) const {
  PoseMotion rows = of_pose(frames_.pose(state_, i));
  rows.bottomRightCorner<3, 1>() += sensors_.anchor(frames_, state_, i) / extent_;
  return rows;
}

Eigen::Vector3d WorldMotions::lever(int i) const {
  return sensors_.lever(state_, problem_.rigs.sensor_of_camera[i]) / extent_;
}

void set_camera_modes(const Problem& problem,
                      const linear::ParameterMap& map,
                      const optim::State& state,
                      linear::CameraModes& modes) {
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  if (!is_metric(problem.camera_model)) return;
  const int size = map.camera_size, others = size - kPoseTangent;
  modes.count = kSimilarities + others;
  modes.values.assign(map.column.size() * modes.count, 0.0);  // twins have none (point_rows.hpp)
  const Frames frames(problem);
  for (int i = 0; i < problem.num_cameras(); ++i) {
    Eigen::Map<RowMajor> of_camera(modes.of_camera(i, size), size, modes.count);
    of_camera.topLeftCorner<kPoseTangent, kSimilarities>() = motion_of_pose(frames.pose(state, i));
    for (int k = 0; k < others; ++k) of_camera(kPoseTangent + k, kSimilarities + k) = 1.0;
  }
}

}  // namespace sfmcpp::ba

// What the normal equations leave open: motions of the world, and of sensors in their rigs.
#include <algorithm>
#include <string>

#include "linear_model_work.hpp"
#include "sfmcpp/ba/free_sensors.hpp"
#include "sfmcpp/core/error.hpp"
#include "world_motions.hpp"

namespace sfmcpp::ba {

// A motion of a sensor that nothing tells is shared out among all columns: rounding hides it there.
void LinearModel::require_sensors() {
  constexpr double kLargest = 1e10;  // inflation
  const int first = sensor_column(problem_, work_->space.intrinsics.size());
  const std::vector<std::vector<int>> cameras = FreeSensors(problem_, work_->space.graph).cameras();
  for (std::size_t s = 0; s < cameras.size(); ++s) {
    for (int k = 0; k < kPoseTangent && !cameras[s].empty(); ++k) {
      const int column = work_->space.map.columns_of(cameras[s].front())[first + k];
      if (column == kNoColumn) continue;
      MatrixXd x = MatrixXd::Zero(work_->space.map.num_columns, 1);
      x(column, 0) = 1.0;
      work_->solver->solve_reduced(x);
      if (x(column, 0) * work_->normal().camera_diagonal()[column] <= kLargest) continue;
      throw InvalidArgument("rigs.sensors[" + std::to_string(s) +
                            "]: its pose in the rig is not determined: the rig must turn about "
                            "more than one axis, or its sensors see points in common");
    }
  }
}

// How the columns answer to the seven similarities, in units of the scene's extent; and, beside
// them, how all that is fixed does.
MatrixXd LinearModel::motions(Eigen::Matrix<double, 7, 7>& held) const {
  const WorldMotions world(problem_, work_->space.graph, state_);
  MatrixXd result = MatrixXd::Zero(num_columns(), kSimilarities);
  held.setZero();
  for (int i = 0; i < num_cameras(); ++i) {
    if (work_->graph().observations_of_camera(i) > 0) add_camera(world, i, held, result);
  }
  const std::vector<char> tied = points_tied_to_cameras(problem_, work_->space.graph);
  for (int p = 0; p < num_points(); ++p) {
    if (!tied[p]) continue;
    const PointMotion rows = world.of_point(p);
    if (point_place_[p] < 0) {
      held += rows.transpose() * rows;
    } else {
      result.middleRows<3>(map_.num_columns + 3L * point_place_[p]) = world.extent() * rows;
    }
  }
  for (const ConstraintRows& group : groups_) {
    if (!(group.weight > 0.0)) continue;
    const MatrixXd rows = group.jacobian * result.topRows(group.jacobian.cols());
    held += rows.transpose() * rows / std::max(group.jacobian.squaredNorm(), 1e-300);
  }
  return result;
}

// A camera, and the sensor that it is: how one that is free answers to the growth of the world, and
// that one that stays does not.
void LinearModel::add_camera(const WorldMotions& world,
                             int camera,
                             Eigen::Matrix<double, 7, 7>& held,
                             MatrixXd& motions) const {
  const auto set = [&](int row, const auto& motion) {
    if (const int column = map_.columns_of(camera)[row]; column != kNoColumn)
      motions.row(column) = motion;
  };
  PoseMotion rows = world.of_frame(camera);
  if (problem_.is_fixed_camera(camera)) held += rows.transpose() * rows;
  rows.bottomRows<3>() *= world.extent();
  for (int k = 0; k < kPoseTangent; ++k) set(k, rows.row(k));
  if (!world.frames().any()) return;
  const Eigen::Vector3d lever = world.lever(camera);
  if (!world.sensors().camera_moves(camera)) {
    held(6, 6) += lever.squaredNorm();
    return;
  }
  const int first = sensor_column(problem_, work_->space.intrinsics.size()) + 3;
  const Eigen::RowVectorXd growth = Eigen::RowVectorXd::Unit(kSimilarities, kSimilarities - 1);
  for (int k = 0; k < 3; ++k) set(first + k, world.extent() * lever[k] * growth);
}

// N and H⁻ N: of the motions of the world, as many as the fixed gauge holds columns, those that
// nothing else holds.
void LinearModel::find_unseen() {
  if (held_.empty()) return;
  Eigen::Matrix<double, 7, 7> held;
  const MatrixXd all = motions(held);
  const auto count = static_cast<Index>(held_.size());
  unseen_ = orthonormal_columns(all * symmetric_spectrum(held).vectors.leftCols(count));
  MatrixXd camera = MatrixXd::Zero(work_->space.map.num_columns, count);
  MatrixXd point = MatrixXd::Zero(3L * num_points(), count);
  for (std::size_t c = 0; c < inner_.size(); ++c) {
    if (inner_[c] != kNoColumn) camera.row(inner_[c]) = unseen_.row(static_cast<Index>(c));
  }
  for (std::size_t k = 0; k < points_.size(); ++k)
    point.middleRows<3>(3L * points_[k]) =
        unseen_.middleRows<3>(map_.num_columns + 3 * static_cast<Index>(k));
  solve_all(camera, point);
  of_unseen_ = assembled(camera, point);
}

}  // namespace sfmcpp::ba

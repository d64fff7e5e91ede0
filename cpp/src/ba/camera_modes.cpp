#include "sfmcpp/ba/camera_modes.hpp"

#include <algorithm>

#include <Eigen/Core>

#include "sfmcpp/ba/rigs.hpp"
#include "sfmcpp/cameras/pose.hpp"
#include "sfmcpp/math/so3.hpp"

namespace sfmcpp::ba {
namespace {

constexpr int kSimilarities = 7;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// A small similarity, rotation ω, translation v and scale s, moves a camera centre c by
// ω × c + v + s c and turns the camera by Rᵀω in its own frame.
void set_similarities(const PoseMatrix& pose, Eigen::Ref<RowMajor> modes) {
  modes.topLeftCorner<3, 3>() = pose.leftCols<3>().transpose();
  modes.block<3, 3>(3, 0) = -skew(pose.col(3));
  modes.block<3, 3>(3, 3).setIdentity();
  modes.block<3, 1>(3, 6) = pose.col(3);
}

}  // namespace

void set_camera_modes(const Problem& problem,
                      const linear::ParameterMap& map,
                      const optim::State& state,
                      linear::CameraModes& modes) {
  if (!is_metric(problem.camera_model)) return;
  const int size = map.camera_size, others = size - kPoseTangent;
  modes.count = kSimilarities + others;
  modes.values.assign(map.column.size() * modes.count, 0.0);  // twins have none (point_rows.hpp)
  const Frames frames(problem);
  for (int i = 0; i < problem.num_cameras(); ++i) {
    Eigen::Map<RowMajor> of_camera(modes.of_camera(i, size), size, modes.count);
    set_similarities(frames.pose(state, i), of_camera.topRows(6));
    for (int k = 0; k < others; ++k) of_camera(kPoseTangent + k, kSimilarities + k) = 1.0;
  }
}

}  // namespace sfmcpp::ba

#include "sfmcpp/ba/camera_modes.hpp"

#include <algorithm>

#include <Eigen/Core>

#include "sfmcpp/ba/rigs.hpp"
#include "world_motions.hpp"

namespace sfmcpp::ba {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

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
    of_camera.topLeftCorner<kPoseTangent, kSimilarities>() = motion_of_pose(frames.pose(state, i));
    for (int k = 0; k < others; ++k) of_camera(kPoseTangent + k, kSimilarities + k) = 1.0;
  }
}

}  // namespace sfmcpp::ba

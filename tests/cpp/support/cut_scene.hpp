// Parts of a scene, as ranks hold them (core/exchange.hpp).
#pragma once

#include "support/small_scenes.hpp"

namespace sfmcpp::support {

// Points that no more than three cameras see.
inline OwnedProblem chain_scene() {
  SceneOptions options = perturbed(CameraModelId::kCalibrated);
  options.num_cameras = 40;
  options.num_points = 1201;
  options.window = 3;
  return make_circle_scene(options);
}

// The observations with keep(camera, point).
template <class F>
OwnedProblem observed_where(const OwnedProblem& scene, const F& keep) {
  OwnedProblem kept = scene;
  for (std::vector<int>* index : {&kept.camera_index, &kept.point_index}) index->clear();
  for (std::vector<double>* values : {&kept.pixels, &kept.sigma_px, &kept.covariance_px2})
    values->clear();
  for (std::size_t k = 0; k < scene.camera_index.size(); ++k) {
    const int camera = scene.camera_index[k], point = scene.point_index[k];
    if (!keep(camera, point)) continue;
    kept.observe(camera, point, scene.pixels[2 * k], scene.pixels[2 * k + 1]);
    if (!scene.sigma_px.empty()) kept.sigma_px.push_back(scene.sigma_px[k]);
    if (!scene.covariance_px2.empty()) {
      const auto first = scene.covariance_px2.begin() + 4 * static_cast<std::ptrdiff_t>(k);
      kept.covariance_px2.insert(kept.covariance_px2.end(), first, first + 4);
    }
  }
  return kept;
}

// The points p with p mod num_ranks = rank, and all cameras.
inline OwnedProblem part_of(const OwnedProblem& whole, int rank, int num_ranks) {
  OwnedProblem part =
      observed_where(whole, [&](int, int point) { return point % num_ranks == rank; });
  for (int& point : part.point_index) point /= num_ranks;
  part.points.clear();
  part.fixed_points.clear();
  const int width = whole.view().point_storage();
  for (int p = rank; p < whole.view().num_points(); p += num_ranks) {
    const auto first = whole.points.begin() + static_cast<long>(width) * p;
    part.points.insert(part.points.end(), first, first + width);
    part.fixed_points.push_back(whole.fixed_points[p]);
  }
  return part;
}

}  // namespace sfmcpp::support

#include "sfmcpp/linear/camera_blocks.hpp"

#include <algorithm>

namespace sfmcpp::linear {
namespace {

std::vector<std::vector<int>> later_partners(int num_cameras, const CameraPairs& pairs) {
  std::vector<std::vector<int>> partners(pairs.empty() ? 0 : num_cameras);
  for (const auto& [i, j] : pairs) {
    if (i != j) partners[std::min(i, j)].push_back(std::max(i, j));
  }
  return partners;
}

}  // namespace

CameraPattern make_camera_pattern(const ObservationGraph& graph, const CameraPairs& pairs) {
  const std::vector<std::vector<int>> partners = later_partners(graph.num_cameras, pairs);
  CameraPattern pattern;
  pattern.row_begin.push_back(0);
  std::vector<int> last_row(graph.num_cameras, -1);  // row in which each camera was met last
  for (int i = 0; i < graph.num_cameras; ++i) {
    const auto meet = [&](int j) {
      if (last_row[j] == i) return;
      last_row[j] = i;
      pattern.column.push_back(j);
    };
    pattern.column.push_back(i);
    for (int a = graph.camera_begin[i]; a < graph.camera_begin[i + 1]; ++a) {
      const int end = graph.point_begin[graph.point[a] + 1];
      for (int position = graph.rank[a] + 1; position < end; ++position) {
        meet(graph.camera[graph.of_point[position]]);
      }
    }
    if (!partners.empty()) std::for_each(partners[i].begin(), partners[i].end(), meet);
    std::sort(pattern.column.begin() + pattern.row_begin.back(), pattern.column.end());
    pattern.row_begin.push_back(static_cast<long>(pattern.column.size()));
  }
  return pattern;
}

double num_pair_updates(const ObservationGraph& graph) {
  double pairs = 0.0;
  for (int p = 0; p < graph.num_points; ++p) {
    const double n = graph.observations_of_point(p);
    pairs += n * (n + 1) / 2;
  }
  return pairs;
}

}  // namespace sfmcpp::linear

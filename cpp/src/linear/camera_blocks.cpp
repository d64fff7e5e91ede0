#include "sfmcpp/linear/camera_blocks.hpp"

#include <algorithm>

namespace sfmcpp::linear {

CameraPattern make_camera_pattern(const ObservationGraph& graph) {
  CameraPattern pattern;
  pattern.row_begin.push_back(0);
  std::vector<int> last_row(graph.num_cameras, -1);  // row in which each camera was met last
  for (int i = 0; i < graph.num_cameras; ++i) {
    pattern.column.push_back(i);
    for (int a = graph.camera_begin[i]; a < graph.camera_begin[i + 1]; ++a) {
      const int end = graph.point_begin[graph.point[a] + 1];
      for (int position = graph.rank[a] + 1; position < end; ++position) {
        const int j = graph.camera[graph.of_point[position]];
        if (last_row[j] == i) continue;
        last_row[j] = i;
        pattern.column.push_back(j);
      }
    }
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

#include "sfmcpp/linear/observation_graph.hpp"

#include <algorithm>
#include <numeric>

#include "sfmcpp/core/isa.hpp"

namespace sfmcpp::linear {
namespace {

// begin[k] = how many keys are smaller than k, for k up to and including the number of buckets.
template <class Begins>
void count_smaller(std::span<const int> keys, int num_buckets, Begins& begin) {
  begin.assign(static_cast<std::size_t>(num_buckets) + 1, 0);
  for (int key : keys) ++begin[key + 1];
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
}

// The caller's observations by point, those of a point as they were given; empty where they are so
// already, as in most files.
AlignedVector<int> by_point(std::span<const int> point_index, const AlignedVector<int>& begin) {
  AlignedVector<int> order;
  if (std::is_sorted(point_index.begin(), point_index.end())) return order;
  AlignedVector<int> next = begin;
  order.resize(point_index.size());
  for (std::size_t k = 0; k < point_index.size(); ++k)
    order[next[point_index[k]]++] = static_cast<int>(k);
  return order;
}

// Every array but the counts, in one pass over the points: the cameras of a point take their next
// places.
void place_observations(std::span<const int> camera_index,
                        const AlignedVector<int>& order,
                        ObservationGraph& graph) {
  std::vector<int> next(graph.camera_begin.begin(), graph.camera_begin.end());
  int* of_point = graph.of_point.data();
  for (int p = 0; p < graph.num_points; ++p) {
    const int begin = graph.point_begin[p], end = graph.point_begin[p + 1];
    bool ascending = true;
    for (int k = begin; k < end; ++k) {
      const int source = order.empty() ? k : order[k];
      const int place = next[camera_index[source]]++;
      graph.source[place] = source;
      graph.point[place] = p;
      of_point[k] = place;
      ascending = ascending && (k == begin || of_point[k - 1] < place);
    }
    if (!ascending) std::sort(of_point + begin, of_point + end);
    for (int k = begin; k < end; ++k) graph.rank[of_point[k]] = k;
  }
}

void make_chunks(ObservationGraph& graph) {
  graph.chunk_begin.push_back(0);
  for (int i = 0; i < graph.num_cameras; ++i) {
    const int end = graph.camera_begin[i + 1];
    for (int begin = graph.camera_begin[i]; begin < end; begin += kChunkSize) {
      graph.chunks.push_back({i, begin, std::min(begin + kChunkSize, end)});
    }
    graph.chunk_begin.push_back(static_cast<int>(graph.chunks.size()));
  }
}

}  // namespace

ObservationGraph make_observation_graph(int num_cameras,
                                        int num_points,
                                        std::span<const int> camera_index,
                                        std::span<const int> point_index) {
  ObservationGraph graph;
  graph.num_cameras = num_cameras;
  graph.num_points = num_points;
  count_smaller(camera_index, num_cameras, graph.camera_begin);
  count_smaller(point_index, num_points, graph.point_begin);

  const std::size_t count = camera_index.size();
  for (AlignedVector<int>* array : {&graph.camera, &graph.source, &graph.of_point, &graph.rank})
    array->resize(count);
  graph.point.resize(count + kReadAhead);
  std::fill(graph.point.begin() + static_cast<std::ptrdiff_t>(count), graph.point.end(), 0);
  place_observations(camera_index, by_point(point_index, graph.point_begin), graph);
  for (int i = 0; i < num_cameras; ++i) {
    std::fill(graph.camera.begin() + graph.camera_begin[i],
              graph.camera.begin() + graph.camera_begin[i + 1],
              i);
  }
  make_chunks(graph);
  for (int i = 0; i < num_cameras; ++i)
    graph.of_camera_on_all_ranks.push_back(graph.observations_of_camera(i));
  return graph;
}

}  // namespace sfmcpp::linear

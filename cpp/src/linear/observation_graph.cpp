#include "sfmcpp/linear/observation_graph.hpp"

#include <algorithm>
#include <numeric>

namespace sfmcpp::linear {
namespace {

constexpr int kReadAhead = 8;

// begin[k] = how many keys are smaller than k.
std::vector<int> bucket_begins(std::span<const int> keys, int num_buckets) {
  std::vector<int> begin(static_cast<std::size_t>(num_buckets) + 1, 0);
  for (int key : keys) ++begin[key + 1];
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  return begin;
}

// Positions of `items` sorted by the key of each; equal keys keep their order.
template <class Key>
std::vector<int> stable_sorted(std::span<const int> items,
                               const Key& key,
                               const std::vector<int>& bucket_begin) {
  std::vector<int> begin = bucket_begin;
  std::vector<int> sorted(items.size());
  for (int item : items) {
    int& place = begin[key(item)];
    sorted[place++] = item;
  }
  return sorted;
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
  graph.camera_begin = bucket_begins(camera_index, num_cameras);
  graph.point_begin = bucket_begins(point_index, num_points);

  const std::size_t count = camera_index.size();
  std::vector<int> given(count);
  std::iota(given.begin(), given.end(), 0);
  const std::vector<int> by_point = stable_sorted(
      given, [&](int k) { return point_index[k]; }, graph.point_begin);
  graph.source = stable_sorted(
      by_point, [&](int k) { return camera_index[k]; }, graph.camera_begin);

  graph.camera.resize(count);
  graph.point.resize(count + kReadAhead, 0);
  for (std::size_t k = 0; k < count; ++k) {
    graph.camera[k] = camera_index[graph.source[k]];
    graph.point[k] = point_index[graph.source[k]];
  }
  graph.of_point = stable_sorted(
      given, [&](int k) { return graph.point[k]; }, graph.point_begin);
  graph.rank.resize(count);
  for (std::size_t k = 0; k < count; ++k) graph.rank[graph.of_point[k]] = static_cast<int>(k);
  make_chunks(graph);
  for (int i = 0; i < num_cameras; ++i)
    graph.of_camera_on_all_ranks.push_back(graph.observations_of_camera(i));
  return graph;
}

}  // namespace sfmcpp::linear

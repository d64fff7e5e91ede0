#include "sfmcpp/linear/reduced_structure.hpp"

#include <algorithm>

namespace sfmcpp::linear {
namespace {

// The distinct variable blocks that the columns of a camera belong to: its own, and shared ones.
std::vector<int> blocks_of_camera(const ParameterMap& map, int camera) {
  std::vector<int> blocks;
  for (int k = 0; k < map.camera_size; ++k) {
    const int column = map.columns_of(camera)[k];
    if (column != kNoColumn) blocks.push_back(map.block_of[column]);
  }
  std::sort(blocks.begin(), blocks.end());
  blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
  return blocks;
}

}  // namespace

double num_pair_updates(const ObservationGraph& graph) {
  double pairs = 0.0;
  for (int p = 0; p < graph.num_points; ++p) {
    const double n = graph.observations_of_point(p);
    pairs += n * (n + 1) / 2;
  }
  return pairs;
}

BlockGraph make_block_graph(const CameraPattern& pattern, const ParameterMap& map) {
  BlockGraph graph;
  for (int k = 0; k < map.num_blocks(); ++k)
    graph.size.push_back(map.block_begin[k + 1] - map.block_begin[k]);
  std::vector<std::vector<int>> blocks(pattern.num_rows());
  for (int i = 0; i < pattern.num_rows(); ++i) blocks[i] = blocks_of_camera(map, i);
  for (int i = 0; i < pattern.num_rows(); ++i) {
    for (long block = pattern.row_begin[i]; block < pattern.row_begin[i + 1]; ++block) {
      for (int a : blocks[i]) {
        for (int b : blocks[pattern.column[block]]) {
          if (a != b) graph.edges.emplace_back(std::min(a, b), std::max(a, b));
        }
      }
    }
  }
  std::sort(graph.edges.begin(), graph.edges.end());
  graph.edges.erase(std::unique(graph.edges.begin(), graph.edges.end()), graph.edges.end());
  return graph;
}

ReducedStructure make_sparse_structure(CameraPattern pattern, const ParameterMap& map) {
  ReducedStructure structure{.pattern = std::move(pattern)};
  structure.graph = make_block_graph(structure.pattern, map);
  structure.ordering = order_blocks(structure.graph);
  structure.supernodes = make_supernodes(structure.graph, structure.ordering);
  structure.ordering.position = structure.supernodes.position;
  structure.ordering.factor_bytes = structure.supernodes.num_bytes();
  return structure;
}

}  // namespace sfmcpp::linear

#include "sfmcpp/linear/reduced_structure.hpp"

#include <algorithm>
#include <numeric>

#include "sfmcpp/core/error.hpp"

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
  return structure;
}

BlockLayout::BlockLayout(const BlockGraph& graph, const std::vector<int>& position)
    : first_column_(graph.size.size() + 1), begin_(1), rows_begin_(1) {
  const std::size_t n = graph.size.size();
  std::vector<std::vector<int>> rows(n);
  for (std::size_t k = 0; k < n; ++k) {
    first_column_[position[k] + 1] = graph.size[k];
    rows[k].push_back(static_cast<int>(k));
  }
  std::partial_sum(first_column_.begin(), first_column_.end(), first_column_.begin());
  for (const auto& [a, b] : graph.edges) {
    const auto [low, high] = std::minmax(position[a], position[b]);
    rows[low].push_back(high);
  }
  for (std::size_t k = 0; k < n; ++k) {
    std::sort(rows[k].begin(), rows[k].end());
    std::int64_t height = 0;
    for (int row : rows[k]) {
      rows_.push_back(row);
      offset_.push_back(static_cast<int>(height));
      height += first_column_[row + 1] - first_column_[row];
    }
    const std::int64_t width = first_column_[k + 1] - first_column_[k];
    rows_begin_.push_back(static_cast<std::int64_t>(rows_.size()));
    begin_.push_back(begin_.back() + width * height - width * (width - 1) / 2);
  }
}

BlockPlace BlockLayout::place(int row_block, int column_block) const {
  const auto begin = rows_.begin() + rows_begin_[column_block];
  const auto end = rows_.begin() + rows_begin_[column_block + 1];
  const auto found = std::lower_bound(begin, end, row_block);
  if (found == end || *found != row_block)
    throw Error("a block of the reduced system lies outside its analysed pattern");
  const int last = rows_[rows_begin_[column_block + 1] - 1];
  const std::int64_t height =
      offset_[rows_begin_[column_block + 1] - 1] + first_column_[last + 1] - first_column_[last];
  return {.first = begin_[column_block] + offset_[found - rows_.begin()],
          .stride = height - 1,
          .packed = true};
}

}  // namespace sfmcpp::linear

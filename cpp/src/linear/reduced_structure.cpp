#include "sfmcpp/linear/reduced_structure.hpp"

#include <algorithm>
#include <numeric>

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>

#include "sfmcpp/core/error.hpp"

namespace sfmcpp::linear {
namespace {

using Pattern = Eigen::SparseMatrix<double, Eigen::ColMajor, int>;

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

Pattern symmetric_pattern(const BlockGraph& graph) {
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(graph.size.size() + 2 * graph.edges.size());
  for (int k = 0; k < static_cast<int>(graph.size.size()); ++k) entries.emplace_back(k, k, 1.0);
  for (const auto& [a, b] : graph.edges) {
    entries.emplace_back(a, b, 1.0);
    entries.emplace_back(b, a, 1.0);
  }
  const auto n = static_cast<Eigen::Index>(graph.size.size());
  Pattern pattern(n, n);
  pattern.setFromTriplets(entries.begin(), entries.end());
  return pattern;
}

// Height of each block column of the factor below its diagonal block, by walking the elimination
// tree from every entry of every row (Liu's row subtrees). Indices are places in the order.
std::vector<double> factor_heights(const std::vector<std::vector<int>>& row_entries,
                                   const std::vector<int>& sizes) {
  const int n = static_cast<int>(sizes.size());
  std::vector<int> parent(n, -1), visited(n, -1);
  std::vector<double> height(n, 0.0);
  for (int row = 0; row < n; ++row) {
    visited[row] = row;
    for (int column : row_entries[row]) {
      for (int k = column; visited[k] != row; k = parent[k]) {
        if (parent[k] == -1) parent[k] = row;
        height[k] += sizes[row];
        visited[k] = row;
      }
    }
  }
  return height;
}

void predict_cost(const BlockGraph& graph, BlockOrdering& ordering) {
  const std::size_t n = graph.size.size();
  std::vector<int> sizes(n);
  for (std::size_t k = 0; k < n; ++k) sizes[ordering.position[k]] = graph.size[k];
  std::vector<std::vector<int>> row_entries(n);
  for (const auto& [a, b] : graph.edges) {
    const auto [low, high] = std::minmax(ordering.position[a], ordering.position[b]);
    row_entries[high].push_back(low);
  }
  const std::vector<double> height = factor_heights(row_entries, sizes);
  for (std::size_t k = 0; k < n; ++k) {
    const double d = sizes[k], h = height[k];
    ordering.flops += d * d * d / 3 + d * d * h + d * h * h;
    ordering.factor_entries += d * (d + 1) / 2 + d * h;
  }
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

BlockOrdering order_blocks(const BlockGraph& graph) {
  BlockOrdering ordering;
  if (graph.size.empty()) return ordering;
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> permutation;
  Pattern pattern = symmetric_pattern(graph);
  Eigen::AMDOrdering<int>()(pattern, permutation);  // maps a place to the block that takes it
  ordering.position.resize(graph.size.size());
  for (int place = 0; place < static_cast<int>(graph.size.size()); ++place) {
    ordering.position[permutation.indices()[place]] = place;
  }
  predict_cost(graph, ordering);
  return ordering;
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

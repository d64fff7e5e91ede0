#include "sfmcpp/linear/block_ordering.hpp"

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>

#include "sfmcpp/linear/elimination_tree.hpp"

namespace sfmcpp::linear {
namespace {

using Pattern = Eigen::SparseMatrix<double, Eigen::ColMajor, int>;

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

// The block at each place.
std::vector<int> minimum_degree(const BlockGraph& graph) {
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> permutation;
  Eigen::AMDOrdering<int>()(symmetric_pattern(graph), permutation);
  return {permutation.indices().begin(), permutation.indices().end()};
}

// The same order, subtrees of its elimination tree put together: the fill does not change.
BlockOrdering postordered(const BlockGraph& graph,
                          const Adjacency& adjacency,
                          std::vector<int> block_at) {
  BlockOrdering ordering{.position = inverse_permutation(block_at)};
  EliminationTree tree = make_elimination_tree(adjacency, block_at, ordering.position);
  std::vector<int> order = postorder(tree.parent);
  const std::vector<int> place = inverse_permutation(order);
  EliminationTree renumbered{.parent = std::vector<int>(order.size(), kRoot)};
  for (std::size_t k = 0; k < order.size(); ++k) {
    const int parent = tree.parent[order[k]];
    if (parent != kRoot) renumbered.parent[k] = place[parent];
    order[k] = block_at[order[k]];
  }
  ordering.position = inverse_permutation(order);
  const std::vector<std::int64_t> heights =
      column_heights(graph, adjacency, renumbered, order, ordering.position);
  for (std::size_t k = 0; k < order.size(); ++k) {
    const double d = graph.size[order[k]], h = static_cast<double>(heights[k]) - d;
    ordering.flops += d * d * d / 3 + d * d * h + d * h * h;
    ordering.factor_entries += d * (d + 1) / 2 + d * h;
  }
  ordering.factor_bytes = sizeof(double) * ordering.factor_entries;
  return ordering;
}

}  // namespace

BlockOrdering order_blocks(const BlockGraph& graph) {
  if (graph.size.empty()) return {};
  return postordered(graph, make_adjacency(graph), minimum_degree(graph));
}

}  // namespace sfmcpp::linear

#include "sfmcpp/linear/elimination_tree.hpp"

#include <algorithm>
#include <numeric>

#include "sfmcpp/core/grouping.hpp"

namespace sfmcpp::linear {
namespace {

std::vector<int> first_descendants(std::span<const int> parent) {
  std::vector<int> first(parent.size());
  std::iota(first.begin(), first.end(), 0);
  for (std::size_t k = 0; k < parent.size(); ++k) {
    if (parent[k] != kRoot) first[parent[k]] = std::min(first[parent[k]], first[k]);
  }
  return first;
}

}  // namespace

Adjacency make_adjacency(const BlockGraph& graph) {
  const std::size_t n = graph.size.size();
  Adjacency adjacency{.begin = std::vector<std::int64_t>(n + 1),
                      .neighbour = std::vector<int>(2 * graph.edges.size())};
  for (const auto& [a, b] : graph.edges) {
    ++adjacency.begin[a + 1];
    ++adjacency.begin[b + 1];
  }
  std::partial_sum(adjacency.begin.begin(), adjacency.begin.end(), adjacency.begin.begin());
  std::vector<std::int64_t> next(adjacency.begin.begin(), adjacency.begin.end() - 1);
  // Edges are sorted: smaller neighbours come first, then larger ones, each in ascending order.
  for (const auto& [a, b] : graph.edges) adjacency.neighbour[next[b]++] = a;
  for (const auto& [a, b] : graph.edges) adjacency.neighbour[next[a]++] = b;
  return adjacency;
}

// Liu 1986, with path compression.
EliminationTree make_elimination_tree(const Adjacency& adjacency,
                                      std::span<const int> block_at,
                                      std::span<const int> position) {
  const int n = adjacency.num_nodes();
  EliminationTree tree{.parent = std::vector<int>(n, kRoot)};
  std::vector<int> ancestor(n, kRoot);
  for (int row = 0; row < n; ++row) {
    for (int neighbour : adjacency.of(block_at[row])) {
      int node = position[neighbour];
      while (node != kRoot && node < row) {
        const int next = ancestor[node];
        ancestor[node] = row;
        if (next == kRoot) tree.parent[node] = row;
        node = next;
      }
    }
  }
  return tree;
}

std::vector<int> postorder(std::span<const int> parent) {
  const int n = static_cast<int>(parent.size());
  std::vector<int> first_child(n + 1, kRoot), sibling(n, kRoot);
  for (int node = n - 1; node >= 0; --node) {
    const int above = parent[node] == kRoot ? n : parent[node];
    sibling[node] = first_child[above];
    first_child[above] = node;
  }
  std::vector<int> order, stack;
  order.reserve(n);
  for (int root = first_child[n]; root != kRoot; root = sibling[root]) {
    stack.push_back(root);
    while (!stack.empty()) {
      const int node = stack.back();
      const int child = first_child[node];
      if (child == kRoot) {
        order.push_back(node);
        stack.pop_back();
      } else {
        first_child[node] = sibling[child];
        stack.push_back(child);
      }
    }
  }
  return order;
}

// Gilbert, Ng & Peyton 1994, each row counted as often as its block has rows: a column has row i if
// it lies in the subtree of row i, and that is the union of the paths from its leaves to i. A leaf
// adds the row along its path; the least common ancestor with the leaf before takes it back.
std::vector<std::int64_t> column_heights(const BlockGraph& graph,
                                         const Adjacency& adjacency,
                                         const EliminationTree& tree,
                                         std::span<const int> block_at,
                                         std::span<const int> position) {
  const int n = adjacency.num_nodes();
  const std::vector<int> first = first_descendants(tree.parent);
  std::vector<std::int64_t> height(n, 0);
  std::vector<int> latest_first(n, -1), leaf_before(n, -1);
  DisjointSets subtrees(n);  // of nodes seen so far; their roots stand for them
  for (int node = 0; node < n; ++node) {
    const int parent = tree.parent[node];
    if (first[node] == node) height[node] += graph.size[block_at[node]];
    if (parent != kRoot) height[parent] -= graph.size[block_at[node]];
    for (int neighbour : adjacency.of(block_at[node])) {
      const int row = position[neighbour];
      if (row <= node || first[node] <= latest_first[row]) continue;  // not a leaf of this row
      height[node] += graph.size[neighbour];
      if (leaf_before[row] != -1) height[subtrees.root(leaf_before[row])] -= graph.size[neighbour];
      latest_first[row] = first[node];
      leaf_before[row] = node;
    }
    if (parent != kRoot) subtrees.join(node, parent);
  }
  for (int node = 0; node < n; ++node) {
    if (tree.parent[node] != kRoot) height[tree.parent[node]] += height[node];
  }
  return height;
}

std::vector<int> inverse_permutation(std::span<const int> permutation) {
  std::vector<int> inverse(permutation.size());
  for (std::size_t k = 0; k < permutation.size(); ++k)
    inverse[permutation[k]] = static_cast<int>(k);
  return inverse;
}

}  // namespace sfmcpp::linear

// The elimination tree of a matrix of blocks and the heights of the columns of its factor, in time
// nearly linear in the number of coupled pairs.
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace sfmcpp::linear {

// A sparse symmetric matrix of blocks: a node for each variable block, an edge for each pair that
// meets in a block which is not zero.
struct BlockGraph {
  std::vector<int> size;                   // columns of each variable block
  std::vector<std::pair<int, int>> edges;  // (smaller, larger) block of each coupled pair, sorted
};

// The neighbours of each node of a block graph: both halves of the symmetric matrix, by rows.
struct Adjacency {
  std::vector<std::int64_t> begin;
  std::vector<int> neighbour;  // ascending within a row

  int num_nodes() const { return static_cast<int>(begin.size()) - 1; }
  std::span<const int> of(int node) const {
    return {neighbour.data() + begin[node], neighbour.data() + begin[node + 1]};
  }
};

Adjacency make_adjacency(const BlockGraph& graph);

inline constexpr int kRoot = -1;

// Nodes are places of an order of elimination, and the parent of a node is the first later block
// that its column of the factor has an entry in.
struct EliminationTree {
  std::vector<int> parent;  // or kRoot
};

// `block_at`: the block at each place; `position`: its inverse.
EliminationTree make_elimination_tree(const Adjacency& adjacency,
                                      std::span<const int> block_at,
                                      std::span<const int> position);

// The nodes of a forest, children before parents and every subtree together; children come in
// ascending order.
std::vector<int> postorder(std::span<const int> parent);

// Rows of each column of the factor, those of the block itself included. The order must be a
// postorder of its own tree.
std::vector<std::int64_t> column_heights(const BlockGraph& graph,
                                         const Adjacency& adjacency,
                                         const EliminationTree& tree,
                                         std::span<const int> block_at,
                                         std::span<const int> position);

std::vector<int> inverse_permutation(std::span<const int> permutation);

}  // namespace sfmcpp::linear

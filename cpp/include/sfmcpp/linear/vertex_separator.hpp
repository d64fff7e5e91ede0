// Small sets of nodes that cut a graph into two parts of similar weight.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "sfmcpp/core/parallel.hpp"

namespace sfmcpp::linear {

inline constexpr int kNone = -1;  // of a node: no place, no partner

// Symmetric, without loops.
struct WeightedGraph {
  std::vector<std::int64_t> begin{0};
  std::vector<int> neighbour;
  std::vector<int> edge_weight;  // as `neighbour`
  std::vector<int> weight;       // of each node

  int num_nodes() const { return static_cast<int>(weight.size()); }
  std::span<const int> of(int node) const {
    return {neighbour.data() + begin[node], neighbour.data() + begin[node + 1]};
  }
};

enum Side : char { kLeft = 0, kRight = 1, kSeparator = 2 };

// The side of each node; no neighbour of a left node is a right one. Multilevel: pairs of nodes are
// contracted along heavy edges, level by level; the coarsest graph is cut by growing regions, and
// the cut is refined on every level on the way back (Hendrickson & Leland 1995, Karypis & Kumar
// 1998; separators moved node by node as by Fiduccia & Mattheyses 1982). The same result each time,
// for any number of threads.
std::vector<Side> find_separator(const WeightedGraph& graph, ThreadPool* pool = nullptr);

}  // namespace sfmcpp::linear

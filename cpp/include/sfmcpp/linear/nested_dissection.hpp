#pragma once

#include <vector>

#include "sfmcpp/linear/elimination_tree.hpp"

namespace sfmcpp::linear {

// Places to blocks, by approximate minimum degree.
std::vector<int> minimum_degree(const Adjacency& adjacency);

// The same by nested dissection (George 1973): a set of blocks that cuts the graph comes last, its
// two parts before it in the same way; small parts by minimum degree. Blocks that meet many more
// others than is usual, as intrinsics that many cameras share, come last of all.
std::vector<int> nested_dissection(const BlockGraph& graph, const Adjacency& adjacency);

// What a factorisation costs in an order; subtrees of the elimination tree are put together in it,
// which does not change the fill.
BlockOrdering predict(const BlockGraph& graph,
                      const Adjacency& adjacency,
                      std::vector<int> block_at);

}  // namespace sfmcpp::linear

// Orders of elimination for the variable blocks of a sparse symmetric matrix, and what a
// factorisation in that order costs. Everything here counts blocks, not scalars.
#pragma once

#include <vector>

#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/linear/elimination_tree.hpp"

namespace sfmcpp::linear {

struct BlockOrdering {
  std::vector<int> position;  // place of each block in the elimination order
  double flops = 0.0;         // of the Cholesky factorisation
  double factor_entries = 0.0;
  double factor_bytes = 0.0;  // as stored
};

// The better of approximate minimum degree and nested dissection, by their flops. A block coupled
// with many others comes last, as intrinsics that many cameras share: the border of the matrix.
BlockOrdering order_blocks(const BlockGraph& graph, ThreadPool& pool);

// The block at each place of the order, by approximate minimum degree.
std::vector<int> minimum_degree(const Adjacency& adjacency);

// The same by nested dissection (George 1973): a set of blocks that cuts the graph comes last, its
// two parts before it in the same way; small parts by minimum degree. Blocks that are coupled with
// many more others than is usual, as intrinsics that many cameras share, come last of all.
std::vector<int> nested_dissection(const BlockGraph& graph,
                                   const Adjacency& adjacency,
                                   ThreadPool& pool);

// What a factorisation costs in an order; subtrees of the elimination tree are put together in it,
// which does not change the fill.
BlockOrdering predict(const BlockGraph& graph,
                      const Adjacency& adjacency,
                      std::vector<int> block_at);

}  // namespace sfmcpp::linear

// Orders of elimination for the variable blocks of a sparse symmetric matrix, and what a
// factorisation in that order costs. Everything here counts blocks, not scalars.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

namespace sfmcpp::linear {

struct BlockGraph {
  std::vector<int> size;                   // columns of each variable block
  std::vector<std::pair<int, int>> edges;  // (smaller, larger) block of each coupled pair, sorted
};

struct BlockOrdering {
  std::vector<int> position;  // place of each block in the elimination order
  double flops = 0.0;         // of the Cholesky factorisation
  double factor_entries = 0.0;
  double factor_bytes = 0.0;  // as stored
};

// The better of approximate minimum degree and nested dissection, by their flops. A block coupled
// with many others comes last, as intrinsics that many cameras share: the border of the matrix.
BlockOrdering order_blocks(const BlockGraph& graph);

}  // namespace sfmcpp::linear

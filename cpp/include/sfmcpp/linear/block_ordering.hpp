// The graph of the reduced system by variable blocks, a fill-reducing order of it, and what the
// sparse factorisation will cost. All symbolic work is done on blocks: cameras, not scalars.
#pragma once

#include <utility>
#include <vector>

#include "sfmcpp/linear/camera_blocks.hpp"
#include "sfmcpp/linear/parameter_map.hpp"

namespace sfmcpp::linear {

struct BlockGraph {
  std::vector<int> size;                   // columns of each variable block
  std::vector<std::pair<int, int>> edges;  // (smaller, larger) block of each coupled pair, sorted
};

BlockGraph make_block_graph(const CameraPattern& pattern, const ParameterMap& map);

struct BlockOrdering {
  std::vector<int> position;  // place of each block in the elimination order
  double flops = 0.0;         // of the Cholesky factorisation
  double factor_entries = 0.0;
};

// Approximate minimum degree.
BlockOrdering order_blocks(const BlockGraph& graph);

}  // namespace sfmcpp::linear

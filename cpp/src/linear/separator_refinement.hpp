#pragma once

#include <vector>

#include "sfmcpp/linear/vertex_separator.hpp"

namespace sfmcpp::linear {

// Weights of the left side, the right side, and the separator.
struct CutWeights {
  long of[3] = {0, 0, 0};

  long total() const { return of[0] + of[1] + of[2]; }
  // Small separators first; parts that differ much cost extra.
  double cost() const;
};

CutWeights weigh(const WeightedGraph& graph, const std::vector<Side>& side);

// Moves nodes out of the separator while that makes it lighter, past small hills. `largest_side`:
// the share of the weight that a side may have.
void refine_separator(const WeightedGraph& graph, std::vector<Side>& side, double largest_side);

}  // namespace sfmcpp::linear

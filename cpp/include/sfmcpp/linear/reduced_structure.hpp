// What is known of the reduced camera system before there are numbers, made once for a problem:
// which cameras meet, which variable blocks meet, a fill-reducing order of these, and the panels of
// their factor. All symbolic work is done on blocks, not on scalars.
#pragma once

#include <vector>

#include "sfmcpp/linear/block_ordering.hpp"
#include "sfmcpp/linear/camera_pattern.hpp"
#include "sfmcpp/linear/parameter_map.hpp"
#include "sfmcpp/linear/supernodes.hpp"

namespace sfmcpp::linear {

// Σ over the points of this rank of n_p (n_p + 1) / 2: camera pairs to update in one formation of
// S.
double num_pair_updates(const ObservationGraph& graph);

BlockGraph make_block_graph(const CameraPattern& pattern, const ParameterMap& map);

struct ReducedStructure {
  CameraPattern pattern;
  // Of a sparse factorisation only.
  BlockGraph graph{};
  BlockOrdering ordering{};  // its positions are those of the supernodes
  Supernodes supernodes{};
};

ReducedStructure make_sparse_structure(CameraPattern pattern, const ParameterMap& map);

}  // namespace sfmcpp::linear

// Symbolic analysis of the reduced camera system, done once for a problem and on blocks, not
// scalars: which cameras meet, which variable blocks meet, a fill-reducing order of these, and the
// panels of their factor.
#pragma once

#include <span>
#include <vector>

#include "sfmcpp/core/exchange.hpp"
#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/linear/block_ordering.hpp"
#include "sfmcpp/linear/camera_terms.hpp"
#include "sfmcpp/linear/observation_graph.hpp"
#include "sfmcpp/linear/parameter_map.hpp"
#include "sfmcpp/linear/supernodes.hpp"

namespace sfmcpp::linear {

// Block (i, j), j ≥ i, is stored when cameras i and j see a common point, are one of `pairs`
// (camera_terms.hpp), or i = j. Values lie row after row, each block in panel layout.
struct CameraPattern {
  std::vector<long> row_begin;  // blocks of row i: [row_begin[i], row_begin[i + 1])
  std::vector<int> column;  // camera j of each block, ascending within a row; the first is i itself

  int num_rows() const { return static_cast<int>(row_begin.size()) - 1; }
  long num_blocks() const { return row_begin.back(); }
  // Cameras of the blocks of a row, the diagonal one first, and of those behind it.
  std::span<const int> columns_of_row(int i) const {
    return {column.data() + row_begin[i], column.data() + row_begin[i + 1]};
  }
  std::span<const int> columns_behind(int i) const { return columns_of_row(i).subspan(1); }
};

// A row is the union of the tracks of its camera, as sets of 64 cameras in the bits of a word, and
// is finished early once it has all later cameras. So long tracks, whose pairs would take longer to
// list than the system takes to solve, cost little more than their observations.
CameraPattern make_camera_pattern(const ObservationGraph& graph,
                                  const CameraPairs& pairs,
                                  ThreadPool& pool);
// The same for the points of all ranks.
CameraPattern make_global_camera_pattern(const ObservationGraph& graph,
                                         const CameraPairs& pairs,
                                         ThreadPool& pool,
                                         Exchange& exchange);

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

ReducedStructure make_sparse_structure(CameraPattern pattern,
                                       const ParameterMap& map,
                                       ThreadPool& pool);

}  // namespace sfmcpp::linear

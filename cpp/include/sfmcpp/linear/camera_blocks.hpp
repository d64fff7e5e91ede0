// The block pattern of the Schur complement over cameras: block (i, j), j ≥ i, is there when
// cameras i and j see a common point, are one of `pairs` (camera_terms.hpp), or i = j. Values lie
// row after row, each block in panel layout.
#pragma once

#include <vector>

#include "sfmcpp/linear/camera_terms.hpp"
#include "sfmcpp/linear/observation_graph.hpp"

namespace sfmcpp::linear {

struct CameraPattern {
  std::vector<long> row_begin;  // blocks of row i: [row_begin[i], row_begin[i + 1])
  std::vector<int> column;  // camera j of each block, ascending within a row; the first is i itself

  int num_rows() const { return static_cast<int>(row_begin.size()) - 1; }
  long num_blocks() const { return row_begin.back(); }
};

CameraPattern make_camera_pattern(const ObservationGraph& graph, const CameraPairs& pairs = {});

// Σ over points of n_p (n_p + 1) / 2: the camera pairs to update in one formation of S.
double num_pair_updates(const ObservationGraph& graph);

}  // namespace sfmcpp::linear

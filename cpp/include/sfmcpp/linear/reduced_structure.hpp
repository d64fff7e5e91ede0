// What is known of the reduced camera system before there are numbers, made once for a problem:
// which cameras meet, which variable blocks meet, a fill-reducing order of these, and where their
// entries lie. All symbolic work is done on blocks, not on scalars.
#pragma once

#include <cstdint>
#include <vector>

#include "sfmcpp/linear/block_ordering.hpp"
#include "sfmcpp/linear/camera_pattern.hpp"
#include "sfmcpp/linear/parameter_map.hpp"

namespace sfmcpp::linear {

// Σ over the points of this rank of n_p (n_p + 1) / 2: camera pairs to update in one formation of
// S.
double num_pair_updates(const ObservationGraph& graph);

BlockGraph make_block_graph(const CameraPattern& pattern, const ParameterMap& map);

struct ReducedStructure {
  CameraPattern pattern;
  // Of a sparse factorisation only.
  BlockGraph graph{};
  BlockOrdering ordering{};
};

ReducedStructure make_sparse_structure(CameraPattern pattern, const ParameterMap& map);

// Entry (r, c) of a pair of blocks lies at first + c · stride + r, less c (c − 1) / 2 where columns
// hold nothing above the diagonal.
struct BlockPlace {
  std::int64_t first = 0;
  std::int64_t stride = 0;
  bool packed = false;

  std::int64_t of(std::int64_t r, std::int64_t c) const {
    return first + c * stride + r - (packed ? c * (c - 1) / 2 : 0);
  }
};

// The lower triangle of the reduced matrix in elimination order, compressed by columns. Blocks are
// numbered by their place in that order.
class BlockLayout {
 public:
  BlockLayout(const BlockGraph& graph, const std::vector<int>& position);

  int num_blocks() const { return static_cast<int>(first_column_.size()) - 1; }
  int num_columns() const { return first_column_.back(); }
  std::int64_t num_entries() const { return begin_.back(); }
  int first_column(int block) const { return first_column_[block]; }
  // Requires row_block ≥ column_block; Error if the two are not coupled.
  BlockPlace place(int row_block, int column_block) const;

  // Calls f(row) for the entries of a column, in their order.
  template <class F>
  void for_each_row(int block, int column, const F& f) const {
    for (std::int64_t k = rows_begin_[block]; k < rows_begin_[block + 1]; ++k) {
      const int end = first_column_[rows_[k] + 1];
      for (int r = rows_[k] == block ? column : first_column_[rows_[k]]; r < end; ++r) f(r);
    }
  }

 private:
  std::vector<int> first_column_;         // of each block, and the end
  std::vector<std::int64_t> begin_;       // first entry of each block column, and the end
  std::vector<std::int64_t> rows_begin_;  // of each block column, in `rows_` and `offset_`
  std::vector<int> rows_;                 // blocks on and below the diagonal, ascending
  std::vector<int> offset_;               // rows of the blocks before, within the block column
};

}  // namespace sfmcpp::linear

// Supernodes: consecutive blocks of the elimination order whose columns of the factor have the same
// rows below. Each is kept as one dense panel, so that the factorisation is made of products of
// dense matrices. Small supernodes are joined with the one above where the zeros that this stores
// cost less than it saves.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "sfmcpp/linear/block_ordering.hpp"

namespace sfmcpp::linear {

// Column-major: first the rows of the supernode's own columns, `top` with padding, then the rows
// below. Columns are padded to a multiple of kPanel (`stored_columns`), rows to whole strips.
struct SupernodePanel {
  int columns = 0;
  int stored_columns = 0;
  int top = 0;
  int height = 0;         // rows below the own ones
  std::int64_t rows = 0;  // all, with padding
  std::int64_t stride = 0;
  std::int64_t first = 0;  // entry of the whole factor
};

// Supernodes of one or several whole subtrees, which may be factored at the same time as others.
// The cut does not depend on the number of threads.
struct Subtrees {
  int first;
  int last;
  // Of the supernodes above, what the rows below these reach: places, and their first rows among
  // all of them.
  std::vector<int> rows{};
  std::vector<int> row_offset{};
  int height = 0;
};

struct Supernodes {
  std::vector<int> position;      // place of each block: the order may change within the same fill
  std::vector<int> first_column;  // of the block at each place, and the end
  std::vector<int> begin;         // first place of each supernode, and the end
  std::vector<int> of_place;      // supernode of each place
  std::vector<int> parent;        // of each supernode, or kRoot
  std::vector<std::int64_t> rows_begin;
  std::vector<int> rows;        // places of the blocks below each supernode, ascending
  std::vector<int> row_offset;  // of each of them among the rows below
  std::vector<SupernodePanel> panel;
  std::int64_t num_entries = 0;  // stored, with zeros and padding
  double flops = 0.0;            // the same
  std::vector<Subtrees> subtrees;
  std::vector<int> top;  // supernodes in no subtree, ascending: they come after all of these

  int count() const { return static_cast<int>(parent.size()); }
  double num_bytes() const;  // of the factor and of what is gathered on the way to it
  int columns_begin(int s) const { return first_column[begin[s]]; }
  std::span<const int> rows_of(int s) const {
    return {rows.data() + rows_begin[s], rows.data() + rows_begin[s + 1]};
  }
  std::span<const int> offsets_of(int s) const {
    return {row_offset.data() + rows_begin[s], rows_of(s).size()};
  }
};

// The ordering must be a postorder of its elimination tree.
Supernodes make_supernodes(const BlockGraph& graph, const BlockOrdering& ordering);

}  // namespace sfmcpp::linear

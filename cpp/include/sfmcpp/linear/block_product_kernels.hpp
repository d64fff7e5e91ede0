// The product of a symmetric matrix of D×D blocks, of which one half is kept in single precision,
// with a vector. Blocks are widened as they are read: the sums are in double precision, so that the
// matrix is exactly symmetric and conjugate gradients see rounding of its entries alone. What
// blocks add to a column is rounded to a grid first (sum_grid.hpp), so that they may add in any
// order.
#pragma once

#include "sfmcpp/core/isa.hpp"

namespace sfmcpp::linear {

struct BlockProductKernels {
  // With the n blocks B_k = (i, column[k]) of row i: out_i += Σ B_k x_k and out_k += B_kᵀ x_i, with
  // D numbers of `x` and `out` for every camera; `out` begins with camera `first`. `middle` is that
  // of the grid.
  void (*add_row)(int n,
                  const float* blocks,
                  const int* column,
                  int i,
                  int first,
                  const double* x,
                  double middle,
                  double* out);
  // out += B x for a block of block_layout.hpp in double precision.
  void (*add_block)(const double* block, const double* x, double* out);
  // Rounds a block of block_layout.hpp to one as the product wants it: its transpose, in the same
  // layout, with a factor for each row and for each column.
  void (*round)(const double* block, const double* rows, const double* columns, float* out);
};

// `camera_size` must be one of padded_camera_size().
BlockProductKernels block_product_kernels(int camera_size);

SFMCPP_DECLARE_FOR_EACH_ISA(BlockProductKernels product_kernels_for(int camera_size))

}  // namespace sfmcpp::linear

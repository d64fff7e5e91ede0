// The product of a symmetric matrix of D×D blocks, of which one half is kept in single precision,
// with a vector. Blocks are widened as they are read: the sums are in double precision, so that the
// matrix is exactly symmetric and conjugate gradients see rounding of its entries alone. What
// blocks add to the same column is added on grids (sum_grid.hpp), in any order.
#pragma once

#include "sfmcpp/core/isa.hpp"

namespace sfmcpp::linear {

// D numbers for every camera: M of its columns, and what is added on both grids.
struct GridOfSums {
  const double* middles;
  double finer;  // M of the second grid, of that of the first
  double* coarse;
  double* fine;
};

struct BlockProductKernels {
  // With the n blocks B_k = (i, column[k]) of row i: out_i += Σ B_k x_k and out_k += B_kᵀ x_i, with
  // D numbers of `x` and of the sums for every camera; those begin with camera `first`.
  void (*add_row)(int n,
                  const float* blocks,
                  const int* column,
                  int i,
                  int first,
                  const double* x,
                  const GridOfSums& out);
  // out += B x for a block of block_layout.hpp in double precision.
  void (*add_block)(const double* block, const double* x, double* out);
  // Rounds a block of block_layout.hpp to one as the product wants it: its transpose, in the same
  // layout.
  void (*round)(const double* block, float* out);
};

// `camera_size` must be one of padded_camera_size().
BlockProductKernels block_product_kernels(int camera_size);

SFMCPP_DECLARE_FOR_EACH_ISA(BlockProductKernels product_kernels_for(int camera_size))

}  // namespace sfmcpp::linear

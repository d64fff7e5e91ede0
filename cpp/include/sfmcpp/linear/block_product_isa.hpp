// The kernels of one instruction set; only block_sparse_schur.cpp chooses among them
// (core/isa.hpp).
#pragma once

#include "sfmcpp/linear/block_product_kernels.hpp"

#define SFMCPP_DECLARE_BLOCK_PRODUCT(isa)                   \
  namespace sfmcpp::linear::isa {                           \
  BlockProductKernels product_kernels_for(int camera_size); \
  }

SFMCPP_DECLARE_BLOCK_PRODUCT(baseline)
SFMCPP_DECLARE_BLOCK_PRODUCT(avx2)
SFMCPP_DECLARE_BLOCK_PRODUCT(avx512)

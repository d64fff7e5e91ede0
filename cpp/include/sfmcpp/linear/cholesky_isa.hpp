// The kernels of one instruction set; only dense_cholesky.cpp chooses among them (core/isa.hpp).
#pragma once

#include "sfmcpp/linear/cholesky_kernels.hpp"

#define SFMCPP_DECLARE_CHOLESKY(isa)     \
  namespace sfmcpp::linear::isa {        \
  CholeskyKernels cholesky_kernels_of(); \
  }

SFMCPP_DECLARE_CHOLESKY(baseline)
SFMCPP_DECLARE_CHOLESKY(avx2)
SFMCPP_DECLARE_CHOLESKY(avx512)

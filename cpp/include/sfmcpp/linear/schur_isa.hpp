// The kernels of one instruction set; only normal_equations.cpp chooses among them (core/isa.hpp).
#pragma once

#include "sfmcpp/linear/schur_kernels.hpp"

#define SFMCPP_DECLARE_SCHUR(isa)                              \
  namespace sfmcpp::linear::isa {                              \
  SchurKernels kernels_for(int camera_size, Precision stored); \
  }

SFMCPP_DECLARE_SCHUR(baseline)
SFMCPP_DECLARE_SCHUR(avx2)
SFMCPP_DECLARE_SCHUR(avx512)

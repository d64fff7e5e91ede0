// The kernels of one instruction set; only nearest.cpp chooses among them (core/isa.hpp).
#pragma once

#include "sfmcpp/features/nearest_kernels.hpp"

#define SFMCPP_DECLARE_NEAREST(isa)                      \
  namespace sfmcpp::features::isa {                      \
  NearestKernels nearest_kernels_of(bool byte_products); \
  }

SFMCPP_DECLARE_NEAREST(baseline)
SFMCPP_DECLARE_NEAREST(avx2)
SFMCPP_DECLARE_NEAREST(avx512)

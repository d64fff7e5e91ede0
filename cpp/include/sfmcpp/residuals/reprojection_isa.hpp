// The kernels of one instruction set; only kernel_choice.cpp chooses among them (core/isa.hpp).
#pragma once

#include "sfmcpp/residuals/algebraic.hpp"
#include "sfmcpp/residuals/bending.hpp"
#include "sfmcpp/residuals/places.hpp"
#include "sfmcpp/residuals/reprojection.hpp"

#define SFMCPP_DECLARE_REPROJECTION(isa)                     \
  namespace sfmcpp::residuals::isa {                         \
  ReprojectionKernels kernels_for(CameraModelId model);      \
  CostKernels cost_kernels_for(CameraModelId model);         \
  AlgebraicKernel algebraic_kernel_for(CameraModelId model); \
  BendingKernel bending_kernel_for(CameraModelId model);     \
  PlaceKernel place_kernel_for(CameraModelId model);         \
  }

SFMCPP_DECLARE_REPROJECTION(baseline)
SFMCPP_DECLARE_REPROJECTION(avx2)
SFMCPP_DECLARE_REPROJECTION(avx512)

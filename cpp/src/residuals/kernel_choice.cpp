#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/residuals/reprojection_isa.hpp"

namespace sfmcpp::residuals {

ReprojectionKernels reprojection_kernels(CameraModelId model) {
  return SFMCPP_FOR_ACTIVE_ISA(kernels_for(model));
}

CostKernel cost_kernel(CameraModelId model) {
  return SFMCPP_FOR_ACTIVE_ISA(cost_kernel_for(model));
}

AlgebraicKernel algebraic_kernel(CameraModelId model) {
  return SFMCPP_FOR_ACTIVE_ISA(algebraic_kernel_for(model));
}

BendingKernel bending_kernel(CameraModelId model) {
  return SFMCPP_FOR_ACTIVE_ISA(bending_kernel_for(model));
}

}  // namespace sfmcpp::residuals

#include "sfmcpp/residuals/reprojection.hpp"

#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/residuals/algebraic.hpp"

namespace sfmcpp::residuals {

ReprojectionKernels reprojection_kernels(const CameraModel& model) {
  if (model.function() != nullptr) return {};
  return SFMCPP_FOR_ACTIVE_ISA(kernels_for(model.compiled()));
}

CostKernels cost_kernels(const CameraModel& model) {
  if (model.function() != nullptr) return {};
  return SFMCPP_FOR_ACTIVE_ISA(cost_kernels_for(model.compiled()));
}

// Halves first, as the kernels add the lanes of a pack; lanes that it does not have are zero.
double sum_of_cost_lanes(const double* lanes) {
  static_assert(kCostLanes == 8);
  const double quarters[] = {
      lanes[0] + lanes[4], lanes[1] + lanes[5], lanes[2] + lanes[6], lanes[3] + lanes[7]};
  return (quarters[0] + quarters[2]) + (quarters[1] + quarters[3]);
}

AlgebraicKernel algebraic_kernel(const CameraModel& model) {
  if (model.function() != nullptr) return {};
  return SFMCPP_FOR_ACTIVE_ISA(algebraic_kernel_for(model.compiled()));
}

BendingKernel bending_kernel(const CameraModel& model) {
  if (model.function() != nullptr) return {};
  return SFMCPP_FOR_ACTIVE_ISA(bending_kernel_for(model.compiled()));
}

PlaceKernel place_kernel(const CameraModel& model) {
  if (model.function() != nullptr) return {};
  return SFMCPP_FOR_ACTIVE_ISA(place_kernel_for(model.compiled()));
}

}  // namespace sfmcpp::residuals

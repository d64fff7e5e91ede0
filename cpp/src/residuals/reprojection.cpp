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

CompensatedSum SumOfSquares::total() const {
  CompensatedSum total;
  for (int lane = 0; lane < kCostLanes; ++lane) total += CompensatedSum(sums[lane], rests[lane]);
  return total;
}

AlgebraicKernel algebraic_kernel(const CameraModel& model) {
  if (model.function() != nullptr) return {};
  return SFMCPP_FOR_ACTIVE_ISA(algebraic_kernel_for(model.compiled()));
}

BendingKernel bending_kernel(const CameraModel& model) {
  if (model.function() != nullptr) return {};
  return SFMCPP_FOR_ACTIVE_ISA(bending_kernel_for(model.compiled()));
}

PlaceKernels place_kernels(const CameraModel& model) {
  if (model.function() != nullptr) return {};
  return SFMCPP_FOR_ACTIVE_ISA(place_kernels_for(model.compiled()));
}

}  // namespace sfmcpp::residuals

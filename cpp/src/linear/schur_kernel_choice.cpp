#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/linear/schur_isa.hpp"

namespace sfmcpp::linear {

SchurKernels schur_kernels(int camera_size) {
  return SFMCPP_FOR_ACTIVE_ISA(kernels_for(camera_size));
}

}  // namespace sfmcpp::linear

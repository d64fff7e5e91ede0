#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/linear/schur_isa.hpp"

namespace sfmcpp::linear {

SchurKernels schur_kernels(int camera_size) {
  switch (active_isa()) {
#if defined(__x86_64__)
    case Isa::kAvx512:
      return avx512::kernels_for(camera_size);
    case Isa::kAvx2:
      return avx2::kernels_for(camera_size);
#endif
    default:
      return baseline::kernels_for(camera_size);
  }
}

}  // namespace sfmcpp::linear

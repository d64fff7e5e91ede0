#include "sfmcpp/residuals/reprojection.hpp"

#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/residuals/reprojection_isa.hpp"

namespace sfmcpp::residuals {

ReprojectionKernels reprojection_kernels(CameraModelId model) {
  switch (active_isa()) {
#if defined(__x86_64__)
    case Isa::kAvx512:
      return avx512::kernels_for(model);
    case Isa::kAvx2:
      return avx2::kernels_for(model);
#endif
    default:
      return baseline::kernels_for(model);
  }
}

}  // namespace sfmcpp::residuals

#include "sfmcpp/core/eigen_allocator.hpp"

namespace sfmcpp {

template <>
const char CompiledWithTheEigenAllocatorOfTheLibrary<EIGEN_MAX_ALIGN_BYTES,
                                                     EIGEN_MALLOC_ALREADY_ALIGNED != 0>::kYes = 1;

}  // namespace sfmcpp

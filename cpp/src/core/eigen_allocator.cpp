#include "sfmcpp/core/eigen_allocator.hpp"

namespace sfmcpp {

template <int max_align_bytes, bool malloc_is_aligned>
const char CompiledWithTheEigenAllocatorOfTheLibrary<max_align_bytes, malloc_is_aligned>::kYes = 1;

template struct CompiledWithTheEigenAllocatorOfTheLibrary<EIGEN_MAX_ALIGN_BYTES,
                                                          EIGEN_MALLOC_ALREADY_ALIGNED != 0>;

}  // namespace sfmcpp

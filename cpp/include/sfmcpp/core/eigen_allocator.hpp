// Matrices of Eigen that one side of the library's boundary allocates and the other frees.
//
// How Eigen allocates depends on compiler flags: instruction sets, sanitizers. CMake's targets hand
// down the library's choice; who compiles without them and chooses otherwise finds out as the
// program is linked, and not by a heap that is corrupt.
#pragma once

#include <Eigen/Core>

namespace sfmcpp {

template <int max_align_bytes, bool malloc_is_aligned>
struct CompiledWithTheEigenAllocatorOfTheLibrary {
  static const char kYes;
};
// In the library, if anywhere.
extern template struct CompiledWithTheEigenAllocatorOfTheLibrary<EIGEN_MAX_ALIGN_BYTES,
                                                                 EIGEN_MALLOC_ALREADY_ALIGNED != 0>;

namespace {
// NOLINTNEXTLINE(cert-dcl59-cpp,google-build-namespaces): each file that includes this asks
[[gnu::used]] const char* const kEigenAllocator =
    &CompiledWithTheEigenAllocatorOfTheLibrary<EIGEN_MAX_ALIGN_BYTES,
                                               EIGEN_MALLOC_ALREADY_ALIGNED != 0>::kYes;
}  // namespace

}  // namespace sfmcpp

// The kernels of every instruction set that this machine has.
#pragma once

#include <string_view>
#include <vector>

#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/features/nearest_kernels.hpp"
#include "sfmcpp/linear/cholesky_kernels.hpp"
#include "sfmcpp/linear/schur_kernels.hpp"
#include "sfmcpp/residuals/algebraic.hpp"
#include "sfmcpp/residuals/reprojection.hpp"
#include "sfmcpp/residuals/resection.hpp"

namespace sfmcpp::support {

struct InstructionSet {
  std::string_view name;
  residuals::ReprojectionKernels (*reprojection)(CameraModelId);
  residuals::CostKernels (*cost)(CameraModelId);
  residuals::AlgebraicKernel (*algebraic)(CameraModelId);
  residuals::BendingKernel (*bending)(CameraModelId);
  residuals::PlaceKernels (*places)(CameraModelId);
  residuals::ResectionKernels (*resection)(CameraModelId);
  linear::SchurKernels (*schur)(int camera_size, linear::Precision stored);
  linear::CholeskyKernels (*cholesky)();
  features::NearestKernels (*nearest)(bool byte_products);
};

inline std::vector<InstructionSet> instruction_sets() {
  std::vector<InstructionSet> sets{{"baseline",
                                    &residuals::baseline::kernels_for,
                                    &residuals::baseline::cost_kernels_for,
                                    &residuals::baseline::algebraic_kernel_for,
                                    &residuals::baseline::bending_kernel_for,
                                    &residuals::baseline::place_kernels_for,
                                    &residuals::baseline::resection_kernels_for,
                                    &linear::baseline::kernels_for,
                                    &linear::baseline::cholesky_kernels_of,
                                    &features::baseline::nearest_kernels_of}};
#if defined(__x86_64__)
  if (best_isa() >= Isa::kAvx2) {
    sets.push_back({"avx2",
                    &residuals::avx2::kernels_for,
                    &residuals::avx2::cost_kernels_for,
                    &residuals::avx2::algebraic_kernel_for,
                    &residuals::avx2::bending_kernel_for,
                    &residuals::avx2::place_kernels_for,
                    &residuals::avx2::resection_kernels_for,
                    &linear::avx2::kernels_for,
                    &linear::avx2::cholesky_kernels_of,
                    &features::avx2::nearest_kernels_of});
  }
  if (best_isa() >= Isa::kAvx512) {
    sets.push_back({"avx512",
                    &residuals::avx512::kernels_for,
                    &residuals::avx512::cost_kernels_for,
                    &residuals::avx512::algebraic_kernel_for,
                    &residuals::avx512::bending_kernel_for,
                    &residuals::avx512::place_kernels_for,
                    &residuals::avx512::resection_kernels_for,
                    &linear::avx512::kernels_for,
                    &linear::avx512::cholesky_kernels_of,
                    &features::avx512::nearest_kernels_of});
  }
#endif
  return sets;
}

}  // namespace sfmcpp::support

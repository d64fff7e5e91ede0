// The triangular solves of single_precision_cholesky.hpp, x ← L⁻ᵀ L⁻¹ x, for the instruction set
// chosen at run time.
#pragma once

#include "sfmcpp/core/isa.hpp"

namespace sfmcpp::linear {

// The lower triangle in square blocks of so many rows.
inline constexpr int kFactorBlockSize = 8;
inline constexpr int kFactorBlockArea = kFactorBlockSize * kFactorBlockSize;

struct SinglePrecisionFactor {
  int blocks = 0;                    // in a row
  const float* below = nullptr;      // (1, 0), (2, 0), (2, 1), …, each column by column
  const double* inverses = nullptr;  // of the blocks on the diagonal, column by column
};

SFMCPP_DECLARE_FOR_EACH_ISA(void solve_with_factor(const SinglePrecisionFactor& factor, double* x))

}  // namespace sfmcpp::linear

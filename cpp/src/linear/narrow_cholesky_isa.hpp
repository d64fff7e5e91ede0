// The kernel of narrow_cholesky.hpp, x ← L⁻ᵀ L⁻¹ x, of one instruction set; only
// narrow_cholesky.cpp chooses among them (core/isa.hpp).
#pragma once

namespace sfmcpp::linear {

// The triangle in square blocks of so many rows.
inline constexpr int kNarrowRows = 8;
inline constexpr int kNarrowArea = kNarrowRows * kNarrowRows;

struct NarrowFactor {
  int blocks = 0;                    // in a row
  const float* below = nullptr;      // (1, 0), (2, 0), (2, 1), …, each column by column
  const double* inverses = nullptr;  // of the blocks on the diagonal, column by column
};

}  // namespace sfmcpp::linear

#define SFMCPP_DECLARE_NARROW_CHOLESKY(isa)                 \
  namespace sfmcpp::linear::isa {                           \
  void solve_narrow(const NarrowFactor& factor, double* x); \
  }

SFMCPP_DECLARE_NARROW_CHOLESKY(baseline)
SFMCPP_DECLARE_NARROW_CHOLESKY(avx2)
SFMCPP_DECLARE_NARROW_CHOLESKY(avx512)

// Compiled once per instruction set; see core/isa.hpp for what may be used here.
#include "single_precision_cholesky_kernels.hpp"

#include "sfmcpp/core/simd.hpp"

namespace sfmcpp::linear::SFMCPP_ISA {
namespace {

using Rows = Pack<kFactorBlockSize>;

SFMCPP_INLINE const float* block(const SinglePrecisionFactor& factor, int row, int column) {
  return factor.below + static_cast<long>(kFactorBlockArea) * (row * (row - 1L) / 2 + column);
}

// Of a block B: B x, its columns in two sums.
template <class Number>
SFMCPP_INLINE void add_product(const Number* columns, const double* x, Rows& even, Rows& odd) {
  for (int c = 0; c < kFactorBlockSize; c += 2) {
    even += load<kFactorBlockSize>(columns + kFactorBlockSize * c) * Rows(x[c]);
    odd += load<kFactorBlockSize>(columns + kFactorBlockSize * (c + 1)) * Rows(x[c + 1]);
  }
}

// Of Bᵀ x, the terms of each number.
template <class Number>
SFMCPP_INLINE void add_transposed_product(const Number* columns, Rows x, Rows* terms) {
  for (int c = 0; c < kFactorBlockSize; ++c)
    terms[c] += load<kFactorBlockSize>(columns + kFactorBlockSize * c) * x;
}

// Of many factors each comes from memory, and is in the cache on the way back.
constexpr int kBlocksAhead = 16;

void solve_forward(const SinglePrecisionFactor& factor, double* x) {
  for (int row = 0; row < factor.blocks; ++row) {
    double* here = x + kFactorBlockSize * row;
    Rows even(0.0), odd(0.0), solved(0.0), rest(0.0);
    for (int column = 0; column < row; ++column) {
      const float* left = block(factor, row, column);
      prefetch_numbers<kFactorBlockArea>(left + kBlocksAhead * kFactorBlockArea);
      add_product(left, x + kFactorBlockSize * column, even, odd);
    }
    store(here, load<kFactorBlockSize>(here) - (even + odd));
    add_product(factor.inverses + kFactorBlockArea * row, here, solved, rest);
    store(here, solved + rest);
  }
}

SFMCPP_INLINE void set_zero(Rows* terms) {
  for (int c = 0; c < kFactorBlockSize; ++c) terms[c] = Rows(0.0);
}

void solve_backward(const SinglePrecisionFactor& factor, double* x) {
  for (int column = factor.blocks - 1; column >= 0; --column) {
    double* here = x + kFactorBlockSize * column;
    Rows terms[kFactorBlockSize];
    set_zero(terms);
    for (int row = column + 1; row < factor.blocks; ++row)
      add_transposed_product(
          block(factor, row, column), load<kFactorBlockSize>(x + kFactorBlockSize * row), terms);
    for (int c = 0; c < kFactorBlockSize; ++c) here[c] -= sum_of_lanes(terms[c]);
    set_zero(terms);
    add_transposed_product(
        factor.inverses + kFactorBlockArea * column, load<kFactorBlockSize>(here), terms);
    for (int c = 0; c < kFactorBlockSize; ++c) here[c] = sum_of_lanes(terms[c]);
  }
}

}  // namespace

void solve_with_factor(const SinglePrecisionFactor& factor, double* x) {
  solve_forward(factor, x);
  solve_backward(factor, x);
}

}  // namespace sfmcpp::linear::SFMCPP_ISA

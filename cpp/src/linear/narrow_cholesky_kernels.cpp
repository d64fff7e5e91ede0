// Compiled once per instruction set; see core/isa.hpp for what may be used here.
#include "narrow_cholesky_isa.hpp"
#include "sfmcpp/core/simd.hpp"

namespace sfmcpp::linear::SFMCPP_ISA {
namespace {

using Rows = Pack<kNarrowRows>;

SFMCPP_INLINE const float* block(const NarrowFactor& factor, int row, int column) {
  return factor.below + static_cast<long>(kNarrowArea) * (row * (row - 1L) / 2 + column);
}

// Of a block B: B x, its columns in two sums.
template <class Number>
SFMCPP_INLINE void add_product(const Number* columns, const double* x, Rows& even, Rows& odd) {
  for (int c = 0; c < kNarrowRows; c += 2) {
    even += load<kNarrowRows>(columns + kNarrowRows * c) * Rows(x[c]);
    odd += load<kNarrowRows>(columns + kNarrowRows * (c + 1)) * Rows(x[c + 1]);
  }
}

// Of Bᵀ x, the terms of each number.
template <class Number>
SFMCPP_INLINE void add_transposed_product(const Number* columns, Rows x, Rows* terms) {
  for (int c = 0; c < kNarrowRows; ++c)
    terms[c] += load<kNarrowRows>(columns + kNarrowRows * c) * x;
}

void solve_forward(const NarrowFactor& factor, double* x) {
  for (int row = 0; row < factor.blocks; ++row) {
    double* here = x + kNarrowRows * row;
    Rows even(0.0), odd(0.0), solved(0.0), rest(0.0);
    for (int column = 0; column < row; ++column)
      add_product(block(factor, row, column), x + kNarrowRows * column, even, odd);
    store(here, load<kNarrowRows>(here) - (even + odd));
    add_product(factor.inverses + kNarrowArea * row, here, solved, rest);
    store(here, solved + rest);
  }
}

SFMCPP_INLINE void set_zero(Rows* terms) {
  for (int c = 0; c < kNarrowRows; ++c) terms[c] = Rows(0.0);
}

void solve_backward(const NarrowFactor& factor, double* x) {
  for (int column = factor.blocks - 1; column >= 0; --column) {
    double* here = x + kNarrowRows * column;
    Rows terms[kNarrowRows];
    set_zero(terms);
    for (int row = column + 1; row < factor.blocks; ++row)
      add_transposed_product(
          block(factor, row, column), load<kNarrowRows>(x + kNarrowRows * row), terms);
    for (int c = 0; c < kNarrowRows; ++c) here[c] -= sum_of_lanes(terms[c]);
    set_zero(terms);
    add_transposed_product(factor.inverses + kNarrowArea * column, load<kNarrowRows>(here), terms);
    for (int c = 0; c < kNarrowRows; ++c) here[c] = sum_of_lanes(terms[c]);
  }
}

}  // namespace

void solve_narrow(const NarrowFactor& factor, double* x) {
  solve_forward(factor, x);
  solve_backward(factor, x);
}

}  // namespace sfmcpp::linear::SFMCPP_ISA

// The inner loops of the dense Cholesky factorisation, for the instruction set chosen at run time.
//
// Matrices are column-major with leading dimension `ld`, lower triangle. Rows come in strips of
// kStrip, columns in multiples of kPanel; the caller pads.
#pragma once

#include <cstdint>

#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/core/simd.hpp"

namespace sfmcpp::linear {

inline constexpr int kStrip = 16;
inline constexpr int kPanel = 8;

// A lower triangle in strips, each column by column as far as the square on the diagonal: where a
// strip begins, or in it the columns that are the rows of another. Kernels call it (core/isa.hpp).
SFMCPP_INLINE constexpr std::int64_t strip_begin(int strip, int of_columns = 0) {
  constexpr std::int64_t kArea = kStrip * kStrip;
  return kArea * (std::int64_t{strip} * (strip + 1) / 2 + of_columns);
}

// Consecutive rows of one panel that are consecutive in another.
struct RowRun {
  int source;
  int target;
  int length;
};

struct CholeskyKernels {
  // c −= a bᵀ for one strip: a is kStrip × inner, b is columns × inner, c is kStrip × columns.
  void (*update)(const double* a, const double* b, double* c, long ld, int inner, int columns);
  // Strips of rows, each of them kStrip × inner without gaps, one after the other.
  void (*pack)(const double* a, long ld, int rows, int inner, double* packed);
  // The same as update for packed strips a (one) and b (as many as have the columns).
  void (*update_packed)(
      const double* a, const double* b, double* c, long ld, int inner, int columns);
  // a ← its Cholesky factor, a square of `size` (a multiple of kPanel; rows to whole strips). The
  // strict upper triangle is overwritten with unspecified values. False: not positive definite.
  bool (*factor)(double* a, long ld, int size);
  // x ← x l⁻ᵀ for one strip x of `size` columns and a factor l of that size.
  void (*solve_strip)(const double* l, double* x, long ld, int size);
  // target[run.target + k] += source[run.source + k] for the rows of the runs within [begin, end)
  // of the source.
  void (*add_runs)(const double* source, double* target, const RowRun* runs, int begin, int end);
  // Triangular solves with a trapezoid l of `columns` columns and `rows` rows. Forward: x ← l⁻¹ x
  // for the first `columns` entries, whose products with the rows below are subtracted from the
  // other entries. Backward: x ← l⁻ᵀ x for the first, given the others.
  void (*forward)(const double* l, long ld, int columns, int rows, double* x);
  void (*backward)(const double* l, long ld, int columns, int rows, double* x);
  // The same with a lower triangle in strips, for the entries of x of one of them. Forward, given
  // those from strip `first` on before it (the others are zero); backward, given those of the
  // strips behind it.
  void (*forward_strip)(const double* l, int first, int strip, double* x);
  void (*backward_strip)(const double* l, int strip, int num_strips, double* x);
};

CholeskyKernels cholesky_kernels();

SFMCPP_DECLARE_FOR_EACH_ISA(CholeskyKernels cholesky_kernels_of())

}  // namespace sfmcpp::linear

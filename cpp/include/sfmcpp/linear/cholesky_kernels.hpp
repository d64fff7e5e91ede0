// The inner loops of the dense Cholesky factorisation, for the instruction set chosen at run time.
//
// Matrices are column-major with leading dimension `ld`, lower triangle. Rows come in strips of
// kStrip, columns in multiples of kPanel; the caller pads.
#pragma once

namespace sfmcpp::linear {

inline constexpr int kStrip = 16;
inline constexpr int kPanel = 8;

struct CholeskyKernels {
  // c −= a bᵀ for one strip: a is kStrip × inner, b is columns × inner, c is kStrip × columns.
  void (*update)(const double* a, const double* b, double* c, long ld, int inner, int columns);
  // a ← its Cholesky factor, a square of `size` (a multiple of kStrip). The strict upper triangle
  // is overwritten with anything. False: not positive definite.
  bool (*factor)(double* a, long ld, int size);
  // x ← x l⁻ᵀ for one strip x of `size` columns and a factor l of that size.
  void (*solve_strip)(const double* l, double* x, long ld, int size);
  // x ← l⁻¹ x, and x ← l⁻ᵀ x.
  void (*forward)(const double* l, long ld, int size, double* x);
  void (*backward)(const double* l, long ld, int size, double* x);
};

CholeskyKernels cholesky_kernels();

}  // namespace sfmcpp::linear

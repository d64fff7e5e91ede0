#pragma once

#include <span>

namespace sfmcpp::linear {

// Factors the lower triangle of the column-major n×n matrix in place (A = L Lᵀ) and solves A x = b in
// `x`. Returns false if A is not positive definite. One thread, so that the bits do not depend on how
// many threads a BLAS library would take; and OpenBLAS' threads would spin against ours.
bool dense_cholesky_solve(int n, double* matrix, std::span<double> x);

}  // namespace sfmcpp::linear

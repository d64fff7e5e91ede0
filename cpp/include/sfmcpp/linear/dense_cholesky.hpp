#pragma once

#include <span>

#include "sfmcpp/core/parallel.hpp"

namespace sfmcpp::linear {

// Factors the lower triangle of the column-major n×n matrix in place (A = L Lᵀ) and solves A x = b
// in `x`. Returns false if A is not positive definite.
//
// The matrix is cut into fixed tiles; each tile operation is one call of a single-threaded BLAS,
// and the pool runs those that do not depend on each other. The bits do not depend on the number of
// threads, and BLAS threads do not spin against ours.
bool dense_cholesky_solve(int n, double* matrix, std::span<double> x, ThreadPool& pool);

}  // namespace sfmcpp::linear

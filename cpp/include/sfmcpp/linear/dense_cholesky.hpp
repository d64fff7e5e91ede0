#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/linear/cholesky_kernels.hpp"
#include "sfmcpp/linear/panel_products.hpp"

namespace sfmcpp::linear {

// A symmetric positive definite matrix by its lower triangle, column-major, and its factorisation
// in place. Rows are padded to whole strips, the leading dimension to an odd number of cache lines
// (a power of two would map whole rows to a few sets of the cache).
//
// The factorisation (panel_products.hpp) is our own because OpenBLAS' threads spin against ours,
// and tiles of its single-threaded calls gained nothing from a second thread.
class DenseCholesky {
 public:
  explicit DenseCholesky(int size, const CholeskyKernels& kernels = cholesky_kernels());

  int size() const { return size_; }
  // Column by column, `stride` apart; what lies above the diagonal is never read.
  std::span<double> values() { return matrix_; }
  long stride() const { return ld_; }
  double at(int row, int column) const {
    return matrix_[static_cast<std::size_t>(column) * ld_ + row];
  }
  double& at(int row, int column) { return matrix_[static_cast<std::size_t>(column) * ld_ + row]; }

  void set_zero(ThreadPool& pool);
  // False if the matrix is not positive definite.
  bool factorize(ThreadPool& pool);
  // x ← A⁻¹ x.
  void solve(std::span<double> x);
  // The same for every column.
  void solve(Eigen::MatrixXd& x, ThreadPool& pool) const;
  double log_determinant() const;

 private:
  CholeskyKernels kernels_;
  int padded_size_;
  int size_;
  long ld_;
  AlignedVector<double> matrix_;
  std::vector<ProductScratch> scratch_;
};

}  // namespace sfmcpp::linear

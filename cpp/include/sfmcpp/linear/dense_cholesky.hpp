// A symmetric positive definite matrix and its Cholesky factorisation in place.
#pragma once

#include <atomic>
#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/linear/cholesky_kernels.hpp"
#include "sfmcpp/linear/panel_cholesky.hpp"

namespace sfmcpp::linear {

// What the threads that factorise a matrix tell one another of a strip.
struct alignas(64) StripProgress {
  std::atomic<int> solved{0};  // strips of columns of L that are there
  int squared = 0;             // strips of columns whose squares have left the diagonal
};

// The lower triangle lies in strips of kStrip rows, each of them column by column as far as the
// square on the diagonal. That is half the memory of a square matrix, and kernels read it without
// gaps. Rows are padded to whole strips.
//
// The factorisation is our own because OpenBLAS' threads spin against ours, and tiles of its
// single-threaded calls gained nothing from a second thread.
class DenseCholesky {
 public:
  explicit DenseCholesky(int size, const CholeskyKernels& kernels = cholesky_kernels());

  int size() const { return size_; }
  int padded_size() const { return kStrip * num_strips(); }
  // Entry (row, column) of the lower triangle lies at row_places()[row] + kStrip · column; what
  // lies above the diagonal is never read.
  std::span<double> values() { return matrix_; }
  std::span<const std::int64_t> row_places() const { return row_places_; }
  double at(int row, int column) const { return matrix_[place(row, column)]; }
  double& at(int row, int column) { return matrix_[place(row, column)]; }

  // For those who do not set every entry.
  void set_zero(ThreadPool& pool);
  // False if the matrix is not positive definite.
  bool factorize(ThreadPool& pool);
  // x ← A⁻¹ x, of the leading part of A with so many rows: its factor is that of L. Room for whole
  // strips; what is behind those rows is overwritten.
  void solve(std::span<double> x, int rows) const;
  // The same for every column.
  void solve(Eigen::MatrixXd& x, ThreadPool& pool) const;
  // xᵀ A⁻¹ x = BᵀB with B = L⁻¹ x, by one thread: half a solve, from the first entry of x on.
  Eigen::MatrixXd inverse_product(const SparseEntries& x, int columns) const;
  double log_determinant() const;

 private:
  void set_padding();
  int num_strips() const { return static_cast<int>(progress_.size()); }
  std::size_t place(int row, int column) const {
    return static_cast<std::size_t>(row_places_[row] + kStrip * std::int64_t{column});
  }

  CholeskyKernels kernels_;
  int size_;
  std::vector<std::int64_t> row_places_;
  AlignedVector<double> matrix_;
  std::vector<StripProgress> progress_;  // of each strip
};

}  // namespace sfmcpp::linear

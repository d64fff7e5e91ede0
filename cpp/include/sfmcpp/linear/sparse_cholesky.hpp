// Sparse Cholesky factorisation behind one interface: CHOLMOD (its supernodal part is GPL) or
// Eigen.
#pragma once

#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

namespace sfmcpp::linear {

// Lower triangle, compressed by columns, rows ascending, diagonal first. Matrix and factor may have
// more than 2³¹ entries.
struct SparseLower {
  int size = 0;
  std::vector<std::int64_t> column_begin;
  std::vector<std::int64_t> row;
  std::vector<double> value;
};

class SparseCholesky {
 public:
  virtual ~SparseCholesky() = default;
  // False if not positive definite.
  virtual bool factorize(const SparseLower& matrix) = 0;
  virtual void solve(std::vector<double>& x) = 0;
  // Of the factorised matrix.
  virtual double log_determinant() const = 0;
};

// Analyses the pattern; the columns keep their order.
std::unique_ptr<SparseCholesky> make_sparse_cholesky(const SparseLower& pattern);
std::string_view sparse_cholesky_name();

}  // namespace sfmcpp::linear

// A Cholesky factor stored in single precision; the triangular solves are in double precision. Half
// the memory, and the solve stays an exactly linear map of its right-hand side up to double
// rounding, which conjugate gradients need of a preconditioner: rounding x itself would break that.
#pragma once

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/linear/dense_cholesky.hpp"

namespace sfmcpp::linear {

class SinglePrecisionCholesky {
 public:
  // Takes the factor of a matrix that has been factorised.
  void set(const DenseCholesky& cholesky);
  // Length of the vectors of `solve`; entries beyond the size of the matrix are padding.
  int padded_size() const;
  // x ← L⁻ᵀ L⁻¹ x
  void solve(double* x) const;

 private:
  int blocks_ = 0;
  AlignedVector<float> below_;
  AlignedVector<double> inverses_;
};

}  // namespace sfmcpp::linear

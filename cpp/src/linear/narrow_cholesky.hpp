// A Cholesky factor kept in single precision and solved with in double precision: half the memory,
// and an answer that hangs on its right-hand side to the last digits, as rounding to single
// precision of what comes and goes would not let it.
#pragma once

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/linear/dense_cholesky.hpp"

namespace sfmcpp::linear {

class NarrowCholesky {
 public:
  // Of a matrix that is factorised.
  void set(const DenseCholesky& cholesky);
  // Numbers of what is solved for, of which the last are padding.
  int padded_size() const;
  // x ← L⁻ᵀ L⁻¹ x
  void solve(double* x) const;

 private:
  int blocks_ = 0;
  AlignedVector<float> below_;
  AlignedVector<double> inverses_;
};

}  // namespace sfmcpp::linear

// Sums that are exact, because their terms are rounded to multiples of one number first: the same
// bits for every order of the terms, and for every way to divide them among ranks (pre-rounding;
// Demmel & Nguyen 2015, "Parallel reproducible summation").
//
// Σ x with |Σ x| ≤ 2^(k−1) is begun at M = 1.5 · 2^k: each addition then rounds x, or the product
// of a fused multiplication, to a multiple of 2^(k−52), and M is taken off in the end. So the bound
// of a sum must be known beforehand. For the Schur complement it is: the entry of two columns is at
// most √(d_a d_b) whichever points are summed over, with d the diagonal of JᵀJ (Cauchy–Schwarz). A
// sum beyond its bound is still right, to rounding.
//
// Where a processor has no fused multiplication, products have been rounded before, and the order
// of the terms matters in the last digit.
#pragma once

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/linear/normal_equations.hpp"

namespace sfmcpp::linear {

class SumGrid {
 public:
  // Of what the normal equations hold now.
  void set(const NormalEquations& normal);

  // D numbers of each camera, p > 2 √d and a power of two: the entry of two columns is summed from
  // 1.5 p_a p_b. Zero where a column is held.
  const double* powers() const { return powers_.data(); }
  const double* of_camera(int i) const { return powers_.data() + size_ * i; }
  // 1 / p, or zero.
  const double* inverse_of_camera(int i) const { return inverse_.data() + size_ * i; }

 private:
  long size_ = 0;  // D
  AlignedVector<double> powers_, inverse_;
};

// M for Σ x of so many terms, none larger than that.
double middle_of_sum(double largest, double terms);

}  // namespace sfmcpp::linear

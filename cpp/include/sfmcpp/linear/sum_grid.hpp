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

#include <vector>

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

 private:
  long size_ = 0;  // D
  AlignedVector<double> powers_;
};

// Sums of S x over blocks, of which one row gets those of many ranks. The bound is of the largest
// x, so that what one grid rounds off goes to a second and finer one.
struct ProductGrid {
  AlignedVector<double> middles;  // M of every camera column
  double finer = 0.0;             // M of the second grid, of that of the first

  // For the blocks x of all cameras that one of the ranks touches.
  void set(const NormalEquations& normal, const SumGrid& grid, const double* x);
};

// A vector in two parts: multiples of the first grid and of the second.
struct ProductSums {
  std::vector<double> coarse, fine;

  void set_zero(std::size_t size) {
    coarse.assign(size, 0.0);
    fine.assign(size, 0.0);
  }
};

// Adds x to both parts.
inline void add_on_grids(double x, double middle, double finer, double& coarse, double& fine) {
  const double rounded = (x + middle) - middle;
  coarse += rounded;
  fine += ((x - rounded) + middle * finer) - middle * finer;
}

}  // namespace sfmcpp::linear

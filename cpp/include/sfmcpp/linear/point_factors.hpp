// Elimination of the points from the damped normal equations, shared by all linear solvers
// (note eqs 18–22): for each point, V* = L Lᵀ, M = L⁻¹ and y = M b_p. Afterwards
// δp = V*⁻¹ (b_p − Wᵀ δc) = Mᵀ (y − Σ P δc), with P = M Wᵀ one term per observation.
#pragma once

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/linear/normal_equations.hpp"

namespace sfmcpp::linear {

class PointFactors {
 public:
  explicit PointFactors(const NormalEquations& normal);

  void factor(const Damping& damping);

  // M and y of every point, kPointFactor numbers each.
  const double* data() const { return factors_.data(); }

  // δp from Σ P δc.
  void back_substitute(int p, const double* sum, double* delta) const;

 private:
  void factor_point(int p, const Damping& damping);

  const NormalEquations& normal_;
  AlignedVector<double> factors_;
};

}  // namespace sfmcpp::linear

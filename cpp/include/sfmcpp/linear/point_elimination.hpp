// Elimination of the points from the damped normal equations, shared by all linear solvers
// (note eqs 18–22): for each point V* = L Lᵀ, M = L⁻¹, y = M b_p. Afterwards
// δp = Mᵀ (y − Σ Gᵀ Jc δc), in the notation of schur_kernels.hpp.
#pragma once

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/linear/normal_equations.hpp"

namespace sfmcpp::linear {

// out = Mᵀ z, with M as the factors hold it.
inline void multiply_by_transposed_factor(const double* m, const double* z, double* out) {
  out[0] = m[0] * z[0] + m[1] * z[1] + m[3] * z[2];
  out[1] = m[2] * z[1] + m[4] * z[2];
  out[2] = m[5] * z[2];
}

class PointElimination {
 public:
  explicit PointElimination(const NormalEquations& normal);

  void factor(const Damping& damping);

  // M and y of every point, kPointFactor numbers each.
  const double* factors() const { return factors_.data(); }
  const double* factor(int p) const { return factors() + static_cast<long>(kPointFactor) * p; }

  // Σ Gᵀ Jc x of every point, for reduced camera columns x.
  const double* point_sums(const std::vector<double>& x);
  // x of camera i, as `point_sums` was given it: a camera block.
  const double* expanded(int i) const;

  // x = (V + λD)⁻¹ g, three numbers per point.
  void solve(const std::vector<double>& g, std::vector<double>& x) const;

  // δp of every point, given δc in `step.camera`.
  void back_substitute(Step& step);

 private:
  void factor_point(int p, const Damping& damping);

  const NormalEquations& normal_;
  AlignedVector<double> factors_;
  AlignedVector<double> steps_;  // x per camera
  AlignedVector<double> sums_;   // per point
};

}  // namespace sfmcpp::linear

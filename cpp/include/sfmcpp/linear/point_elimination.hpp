// Elimination of the points from the damped normal equations, shared by all linear solvers
// (note eqs 18–22): for each point V* = L Lᵀ, M = L⁻¹, y = M b_p. Afterwards
// δp = Mᵀ (y − Σ Gᵀ Jc δc), in the notation of schur_kernels.hpp.
#pragma once

#include <span>
#include <vector>

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/math/inverse_factor.hpp"

namespace sfmcpp::linear {

// out = Mᵀ M x = (V + λD)⁻¹ x, which may be x.
inline void solve_point(const PointFactor& m, const double* x, double* out) {
  double z[3];
  multiply_by_factor(m, x, z);
  multiply_by_transposed_factor(m, z, out);
}

class PointElimination {
 public:
  explicit PointElimination(const NormalEquations& normal);

  void factor(const Damping& damping);

  const PointFactor* factors() const { return factors_.data(); }  // of every point
  const PointFactor& factor(int p) const { return factors_[p]; }

  // Σ Gᵀ Jc x of every point, for reduced camera columns x.
  const double* point_sums(const std::vector<double>& x);
  // x of camera i, as `point_sums` was given it: a camera block.
  const double* expanded(int i) const;

  // x = (V + λD)⁻¹ g, three numbers per point.
  void solve(const std::vector<double>& g, std::vector<double>& x) const;

  // δp of every point, given δc in `step.camera`.
  void back_substitute(Step& step);

 private:
  const NormalEquations& normal_;
  FactorPoints factor_points_;
  AlignedVector<PointFactor> factors_;
  AlignedVector<double> steps_;  // x per camera
  AlignedVector<double> sums_;   // per point
};

// The damped normal equations with Jᵀ h on the right, for other residuals h than those they were
// filled with, by the same elimination of the points (note eqs 18–22): with g = Σ Aᵀ h and
// t = V*⁻¹ g of each point, the reduced right-hand side is Σ Jᵀ (h − A t), and
// δp = t − Mᵀ Σ Gᵀ J δc, in the notation of schur_kernels.hpp. Two passes over J; none where
// cameras are held, δp = t.
class OtherResiduals {
 public:
  // The references must outlive this object.
  OtherResiduals(const NormalEquations& normal, PointElimination& elimination);

  // The step of the points while the cameras stay; h has two numbers for each observation.
  void solve_points(std::span<const double> residuals, Step& step);
  // The reduced right-hand side; residuals that see cameras alone are taken as zero.
  void reduce(std::span<const double> residuals, std::vector<double>& rhs);
  // δp of every point, given δc in `step.camera`, for the h that was reduced last.
  void back_substitute(Step& step);

 private:
  void eliminate(std::span<const double> residuals, double* shifts);

  const NormalEquations& normal_;
  PointElimination& elimination_;
  AlignedVector<double> shifts_;      // t of each point
  AlignedVector<double> chunk_sums_;  // a camera block per chunk
};

}  // namespace sfmcpp::linear

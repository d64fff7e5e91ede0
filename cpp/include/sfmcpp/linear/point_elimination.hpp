// Elimination of the points from the damped normal equations, shared by all linear solvers
// (note eqs 18–22): for each point V* = L Lᵀ, M = L⁻¹, y = M b_p; for each observation G|r̄
// (notation of schur_kernels.hpp). Afterwards δp = Mᵀ (y − Σ Gᵀ Jc δc).
#pragma once

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/linear/normal_equations.hpp"

namespace sfmcpp::linear {

class PointElimination {
 public:
  explicit PointElimination(const NormalEquations& normal);

  void eliminate(const Damping& damping);

  // G|r̄ from this observation on.
  const double* eliminated(int observation) const {
    return eliminated_.data() + static_cast<long>(kPointRecord) * observation;
  }

  // e = Jc x of every observation; then Σ Gᵀ e of a point.
  void apply_cameras(const std::vector<double>& x);
  const double* applied(int observation) const { return applied_.data() + 2L * observation; }
  void sum_of_point(int p, double* sum) const;

  // δp of every point, given δc in `step.camera`.
  void back_substitute(Step& step);

 private:
  void factor_point(int p, const Damping& damping);

  const NormalEquations& normal_;
  AlignedVector<double> factors_;     // M, y per point
  AlignedVector<double> eliminated_;  // G|r̄ per observation
  AlignedVector<double> applied_;     // e per observation
};

}  // namespace sfmcpp::linear

// Elimination of the points from the damped normal equations, shared by all linear solvers
// (note eqs 18–22).
//
// For each point, V* = L Lᵀ and M = L⁻¹; every observation gets its record G|r̄ = A Mᵀ | r − G y, with
// y = M b_p. Afterwards δp = Mᵀ (y − Σ Gᵀ Jc δc).
#pragma once

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/linear/normal_equations.hpp"

namespace sfmcpp::linear {

class PointElimination {
 public:
  explicit PointElimination(const NormalEquations& normal);

  void eliminate(const Damping& damping);

  const double* eliminated(int observation) const {
    return eliminated_.data() + static_cast<long>(kPointRecord) * observation;
  }

  // e = Jc x for every observation, and Σ Gᵀ e for a point.
  void apply_cameras(const std::vector<double>& x);
  void sum_of_point(int p, double* sum) const;
  const double* applied(int observation) const { return applied_.data() + 2L * observation; }

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

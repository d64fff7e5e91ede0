// The damped normal equations with Jᵀ h on the right, for other residuals h than those they were
// filled with, by the same elimination of the points (note eqs 18–22): with g = Σ Aᵀ h and
// t = V*⁻¹ g of each point, the reduced right-hand side is Σ Jᵀ (h − A t), and
// δp = t − Mᵀ Σ Gᵀ J δc, in the notation of schur_kernels.hpp. Two passes over J; none where
// cameras are held, δp = t.
#pragma once

#include <vector>

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/linear/point_elimination.hpp"

namespace sfmcpp::linear {

class OtherResiduals {
 public:
  // The references must outlive this object.
  OtherResiduals(const NormalEquations& normal, PointElimination& elimination);

  // The step of the points while the cameras stay; h has two numbers for each observation.
  void solve_points(const std::vector<double>& residuals, Step& step);
  // The reduced right-hand side; residuals that see cameras alone are taken as zero.
  void reduce(const std::vector<double>& residuals, std::vector<double>& rhs);
  // δp of every point, given δc in `step.camera`, for the h that was reduced last.
  void back_substitute(Step& step);

 private:
  void eliminate(const std::vector<double>& residuals, std::vector<double>& shifts);

  const NormalEquations& normal_;
  PointElimination& elimination_;
  std::vector<double> shifts_;        // t of each point
  AlignedVector<double> chunk_sums_;  // a camera block per chunk
};

}  // namespace sfmcpp::linear

// The diagonal blocks of JᵀJ alone: a block for each variable block of the reduced system (a
// camera, or intrinsics that several share), one for each point. Cheap, and all that gradient
// methods and alternation need of the normal equations.
//
// Shared intrinsics are blocks of their own and their terms with the poses are left out, and so are
// the terms between two poses. The step of the block diagonal still lowers the quadratic model,
// because no residual sees more than two blocks of cameras, x and y:
// 2 ‖Jx x‖² + 2 ‖Jy y‖² ≥ ‖Jx x + Jy y‖², hence 2 blockdiag(U) − U is not indefinite.
#pragma once

#include <vector>

#include "sfmcpp/linear/camera_block_diagonal.hpp"
#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/linear/point_elimination.hpp"

namespace sfmcpp::linear {

class BlockJacobi {
 public:
  // The normal equations must outlive this object.
  explicit BlockJacobi(const NormalEquations& normal);

  // Factors U + λD and V + λD for what the normal equations hold now.
  void factor(const Damping& damping);

  // δ = blockdiag(U + λD, V + λD)⁻¹ g, for a gradient-like vector g of the shape of a step.
  void solve(const Step& g, Step& step) const;

  // One block Gauss–Seidel sweep on the damped system: δc = (U + λD)⁻¹ b_c with the points held
  // (resection), then δp = (V + λD)⁻¹ (b_p − Wᵀ δc) (intersection).
  void sweep(Step& step);

 private:
  const NormalEquations& normal_;
  CameraBlockDiagonal cameras_;
  PointElimination points_;
  AlignedVector<PointFactor>
      no_factors_;  // M = 0 and y = 0 of every point: cameras as if points held
  std::vector<double> camera_rhs_;
};

}  // namespace sfmcpp::linear

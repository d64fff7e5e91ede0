#pragma once

#include <vector>

#include "sfmcpp/linear/camera_block_diagonal.hpp"
#include "sfmcpp/linear/linear_solver.hpp"
#include "sfmcpp/linear/point_elimination.hpp"

namespace sfmcpp::linear {

// S x without S or W: with e = Jc x, S x = Jcᵀ (e − G Σ Gᵀ e) + B x + λD x, the sum over the
// observations of each point, B of camera_terms.hpp; and G Σ Gᵀ e = A t with t = Mᵀ Σ Gᵀ e. Memory
// is that of the Jacobian.
class ImplicitSchurSolver final : public LinearSolver {
 public:
  ImplicitSchurSolver(const NormalEquations& normal, const LinearSolverOptions& options);

  LinearSolveResult solve(const Damping& damping,
                          Step& step,
                          const std::function<bool()>& should_stop) override;

 private:
  void set_shifts(const double* sums);
  void apply(const std::vector<double>& x, std::vector<double>& out);

  const NormalEquations& normal_;
  LinearSolverOptions options_;
  PointElimination elimination_;
  std::vector<double> diagonal_;  // λD
  std::vector<double> rhs_;
  CameraBlockDiagonal preconditioner_;  // Schur–Jacobi
  AlignedVector<double> shifts_;        // t per point
  AlignedVector<double> chunk_sums_;    // per chunk: a camera block
};

}  // namespace sfmcpp::linear

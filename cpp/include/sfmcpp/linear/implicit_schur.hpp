#pragma once

#include <vector>

#include "sfmcpp/linear/linear_solver.hpp"
#include "sfmcpp/linear/point_elimination.hpp"

namespace sfmcpp::linear {

// S x without S or W: with e = Jc x, S x = Jcᵀ (e − G Σ Gᵀ e) + λD x, the sum over the observations
// of each point; and G Σ Gᵀ e = A t with t = Mᵀ Σ Gᵀ e. Memory is that of the Jacobian.
class ImplicitSchurSolver final : public LinearSolver {
 public:
  ImplicitSchurSolver(const NormalEquations& normal, const LinearSolverOptions& options);

  LinearSolveResult solve(const Damping& damping,
                          Step& step,
                          const std::function<bool()>& should_stop) override;

 private:
  void prepare(const Damping& damping);
  void set_shifts(const double* sums);
  void fold_diagonal_block(int i, const double* block);
  void factor_preconditioner();
  void apply(const std::vector<double>& x, std::vector<double>& out);
  void precondition(const std::vector<double>& in, std::vector<double>& out) const;
  double* block(int b) { return preconditioner_.data() + block_offset_[b]; }

  const NormalEquations& normal_;
  LinearSolverOptions options_;
  PointElimination elimination_;
  std::vector<double> diagonal_;  // λD
  std::vector<double> rhs_;
  std::vector<long> block_offset_;  // of each variable block in `preconditioner_`
  std::vector<double>
      preconditioner_;  // Schur–Jacobi: diagonal blocks of S, then their Cholesky factors
  AlignedVector<double> shifts_;         // t per point
  AlignedVector<double> camera_sums_;    // per chunk or camera: a camera block
  AlignedVector<double> camera_blocks_;  // diagonal block of each camera, panel layout
};

}  // namespace sfmcpp::linear

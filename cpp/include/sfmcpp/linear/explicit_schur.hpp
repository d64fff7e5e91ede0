#pragma once

#include "sfmcpp/linear/linear_solver.hpp"
#include "sfmcpp/linear/point_elimination.hpp"
#include "sfmcpp/linear/reduced_solver.hpp"

namespace sfmcpp::linear {

// Forms S block row by block row: row i is gathered by one task from the points that camera i sees,
// so that there are no locks and every block has its terms added in one fixed order. A row goes to
// the reduced matrix at once; only where cameras share columns all rows are kept and added in
// order.
class ExplicitSchurSolver final : public LinearSolver {
 public:
  ExplicitSchurSolver(const NormalEquations& normal, LinearSolverKind kind);

  LinearSolveResult solve(const Damping& damping,
                          Step& step,
                          const std::function<bool()>& should_stop) override;

  // The factorisation alone, and solutions with it: `x` holds the right-hand side in reduced
  // columns before and the solution after. False where the matrix is not positive definite.
  bool factorize(const Damping& damping);
  bool solve_reduced(std::vector<double>& x);
  const PointElimination& elimination() const { return elimination_; }

 private:
  void form();
  void form_row(int i, int worker, AlignedVector<double>& row);
  void add_camera_terms(int i, const int* block_of_camera, double* row) const;
  void set_rhs(std::vector<double>& rhs) const;

  const NormalEquations& normal_;
  CameraPattern pattern_;
  PointElimination elimination_;
  std::unique_ptr<ReducedSolver> reduced_;
  // The block row that each worker forms; of each camera where cameras share columns.
  std::vector<AlignedVector<double>> rows_;
  AlignedVector<double> rhs_;                      // Σ Jᵀ r̄ per camera
  std::vector<std::vector<int>> block_of_camera_;  // scratch of each worker
};

}  // namespace sfmcpp::linear

#pragma once

#include "sfmcpp/linear/linear_solver.hpp"
#include "sfmcpp/linear/point_elimination.hpp"
#include "sfmcpp/linear/reduced_solver.hpp"

namespace sfmcpp::linear {

// Forms S block row by block row: row i is gathered by one task from the points that camera i sees,
// so that there are no locks and every block has its terms added in one fixed order.
class ExplicitSchurSolver final : public LinearSolver {
 public:
  ExplicitSchurSolver(const NormalEquations& normal, LinearSolverKind kind);

  LinearSolveResult solve(const Damping& damping,
                          Step& step,
                          const std::function<bool()>& should_stop) override;

 private:
  void form();
  void form_row(int i, int worker);
  void set_rhs(std::vector<double>& rhs) const;

  const NormalEquations& normal_;
  CameraPattern pattern_;
  PointElimination elimination_;
  std::unique_ptr<ReducedSolver> reduced_;
  AlignedVector<double> blocks_;                   // S
  AlignedVector<double> rhs_;                      // Σ Jᵀ r̄ per camera
  std::vector<std::vector<int>> block_of_camera_;  // scratch of each worker
};

}  // namespace sfmcpp::linear

#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "schur_operator.hpp"
#include "sfmcpp/linear/camera_block_diagonal.hpp"
#include "sfmcpp/linear/conjugate_gradient.hpp"
#include "sfmcpp/linear/linear_solver.hpp"
#include "sfmcpp/linear/point_elimination.hpp"

namespace sfmcpp::linear {

// Conjugate gradients on the reduced system, multiplied block by block in single precision or, where
// that costs more, from the Jacobian. A tolerance that single precision cannot meet is met by
// corrections of the residual in double precision.
class IterativeSolver final : public LinearSolver {
 public:
  // `structure` null: from the Jacobian.
  IterativeSolver(const NormalEquations& normal,
                  const LinearSolverOptions& options,
                  std::shared_ptr<const ReducedStructure> structure);

  LinearSolveResult solve(const Damping& damping,
                          Step& step,
                          const std::function<bool()>& should_stop) override;

 private:
  using Vector = std::vector<double>;

  ConjugateGradientResult correct(const Vector& residual,
                                  double tolerance,
                                  int max_iterations,
                                  const std::function<bool()>& should_stop,
                                  Vector& x);
  void refine(double tolerance,
              const std::function<bool()>& should_stop,
              ConjugateGradientResult& result,
              Vector& x);
  void apply(SchurOperator& schur, const Vector& x, Vector& out) const;
  Vector residual_of(SchurOperator& schur, const Vector& x) const;

  const NormalEquations& normal_;
  LinearSolverOptions options_;
  PointElimination elimination_;
  std::unique_ptr<SchurOperator> implicit_, blocks_;
  Vector diagonal_;  // λD
  Vector rhs_;
  CameraBlockDiagonal preconditioner_;  // Schur–Jacobi
};

}  // namespace sfmcpp::linear

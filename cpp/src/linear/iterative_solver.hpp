#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "schur_operator.hpp"
#include "schur_preconditioner.hpp"
#include "sfmcpp/linear/conjugate_gradient.hpp"
#include "sfmcpp/linear/linear_solver.hpp"
#include "sfmcpp/linear/point_elimination.hpp"

namespace sfmcpp::linear {

// Conjugate gradients on the reduced system, multiplied block by block in single precision or,
// where that costs more, from the Jacobian. A tolerance that single precision cannot meet is met by
// corrections of the residual in double precision.
class IterativeSolver final : public LinearSolver {
 public:
  // `structure` is of all ranks; null: from the Jacobian.
  IterativeSolver(const NormalEquations& normal,
                  const LinearSolverOptions& options,
                  const std::shared_ptr<const ReducedStructure>& structure);

  LinearSolveResult solve(const Damping& damping,
                          Step& step,
                          const std::function<bool()>& should_stop) override;
  bool wants_camera_modes() const override { return preconditioner_.wants_camera_modes(); }
  std::vector<int> iterations_of_solves() const override { return iterations_of_solves_; }
  void replay(const std::vector<int>& iterations_of_solves) override;
  bool can_solve_again(Unknowns unknowns) const override { return unknowns == Unknowns::kPoints; }
  bool solve_again(Unknowns, std::span<const double> residuals, Step& step) override {
    other_residuals_.solve_points(residuals, step);
    return true;
  }

 private:
  IterativeSolver(const NormalEquations& normal,
                  const LinearSolverOptions& options,
                  const std::shared_ptr<const ReducedStructure>& structure,
                  CameraGroups groups);
  void form(const Damping& damping);
  void learn(int iterations);
  ConjugateGradientResult correct(const Vector& residual,
                                  double tolerance,
                                  int max_iterations,
                                  const std::function<bool()>& should_stop,
                                  Vector& x);
  double norm(const Vector& residual);
  void refine(double tolerance,
              const std::function<bool()>& should_stop,
              ConjugateGradientResult& result,
              Vector& x);
  void precondition(const Vector& in, Vector& out);
  Vector residual_of(DistributedProduct& product, const Vector& x) const;

  const NormalEquations& normal_;
  LinearSolverOptions options_;
  PointElimination elimination_;
  OtherResiduals other_residuals_;
  CameraPartition partition_;
  std::unique_ptr<SchurOperator> implicit_;
  std::unique_ptr<BlockSparseSchur> blocks_;       // null: not formed
  DistributedProduct product_;                     // with the blocks, if there are any
  std::unique_ptr<DistributedProduct> unrounded_;  // where it is needed
  SchurPreconditioner preconditioner_;
  ConjugateGradients conjugate_gradients_;
  std::optional<DampedSystem> formed_;  // what S and the factors of the points are of
  Vector damping_, whole_rhs_;          // of all ranks' columns: λD, and the right-hand side
  Vector diagonal_;  // λD of this rank's columns, as all vectors but those of the preconditioner
  Vector rhs_, solution_;
  std::vector<int> iterations_of_solves_;
  Vector in_, out_;  // of the preconditioner, where there are more ranks
};

}  // namespace sfmcpp::linear

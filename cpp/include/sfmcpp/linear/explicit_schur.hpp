#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>
#include <Eigen/SparseCore>

#include "sfmcpp/linear/linear_solver.hpp"
#include "sfmcpp/linear/point_elimination.hpp"
#include "sfmcpp/linear/schur_rows.hpp"

namespace sfmcpp::linear {

class ReducedSolver;

// Forms S block row by block row: row i is gathered by one task from the points that camera i sees,
// so that there are no locks and every block has its terms added in one fixed order. A row goes to
// the reduced matrix at once. Only what cameras share, the border of the matrix, is added by one
// thread in the order of the rows; then rows are formed in batches, and no more than one is kept.
class ExplicitSchurSolver final : public LinearSolver {
 public:
  // `structure`: null where it has not been computed yet; a sparse solver needs all of it.
  ExplicitSchurSolver(const NormalEquations& normal,
                      LinearSolverKind kind,
                      std::shared_ptr<const ReducedStructure> structure = nullptr);
  ~ExplicitSchurSolver() override;

  LinearSolveResult solve(const Damping& damping,
                          Step& step,
                          const std::function<bool()>& should_stop) override;

  bool can_solve_again(Unknowns) const override { return true; }
  bool solve_again(Unknowns unknowns, std::span<const double> residuals, Step& step) override;

  // The factorisation alone, and solutions with it: `x` holds the right-hand side in reduced
  // columns before and the solution after. False where the matrix is not positive definite.
  bool factorize(const Damping& damping);
  bool solve_reduced(std::vector<double>& x);
  void solve_reduced(Eigen::MatrixXd& x);  // every column
  // xᵀ S⁻¹ x, for several threads of the pool at once, each by its number.
  Eigen::MatrixXd inverse_product(const Eigen::SparseMatrix<double>& x, int worker);
  double log_determinant() const;
  const PointElimination& elimination() const { return elimination_; }

 private:
  bool has_factors_of(const Damping& damping) const;
  void form();
  void form_rows(int begin, int end, int worker, std::span<AlignedVector<double>> rows);
  void add_camera_terms(int i, const int* block_of_camera, double* blocks) const;
  void set_rhs(std::vector<double>& rhs) const;

  const NormalEquations& normal_;
  std::shared_ptr<const ReducedStructure> structure_;
  const CameraPattern& pattern_;
  PointElimination elimination_;
  OtherResiduals other_residuals_;
  SchurRows schur_rows_;
  std::unique_ptr<ReducedSolver> reduced_;
  // The block rows that each worker forms; of each camera of a batch where cameras share columns.
  std::vector<AlignedVector<double>> rows_;
  AlignedVector<double> rhs_;    // Σ Jᵀ r̄ per camera
  std::vector<double> damping_;  // λD
  std::optional<DampedSystem> factored_;
};

}  // namespace sfmcpp::linear

// The gold standard of the linear solvers: the full Jacobian as one dense matrix, made from the
// double-typed camera templates without any code of linear/, and its damped solution by QR.
#pragma once

#include <vector>

#include <Eigen/Core>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/residuals/loss.hpp"
#include "support/linearized_problem.hpp"

namespace sfmcpp::support {

// Rows: two per observation in the caller's order, over σ. Columns: the reduced parameters, then
// three for each free point.
struct DenseSystem {
  Eigen::MatrixXd jacobian;  // of the projection
  Eigen::VectorXd residual;  // observed − projected
  int camera_columns = 0;
  std::vector<int> point_column;  // first column of each point; −1: it may not move
};

DenseSystem make_dense_system(const LinearizedProblem& linearized, const Loss& loss = {});

// λ D, one number per column.
Eigen::VectorXd damping_diagonal(const DenseSystem& system, const linear::Damping& damping);

// The minimum of ‖r − J δ‖² + ‖√(λD) δ‖², by QR of [J; √(λD)].
Eigen::VectorXd solve_by_qr(const DenseSystem& system, const linear::Damping& damping);

// ½‖r‖² − ½‖r − J δ‖².
double model_decrease(const DenseSystem& system, const Eigen::VectorXd& step);

// A step of the solver in the columns of the dense system; NaN if the solve failed.
Eigen::VectorXd flatten(const DenseSystem& system, const linear::Step& step);

}  // namespace sfmcpp::support

// A least-squares system as one dense matrix, and its damped solution by QR: the gold standard of
// the linear solvers.
#pragma once

#include <vector>

#include <Eigen/Core>

#include "sfmcpp/linear/normal_equations.hpp"

namespace sfmcpp::support {

// Two rows or more of every residual. Columns: the reduced parameters, then three for each free
// point.
struct DenseSystem {
  Eigen::MatrixXd jacobian;  // of what is predicted
  Eigen::VectorXd residual;  // observed − predicted
  int camera_columns = 0;
  std::vector<int> point_column;  // first column of each point; −1: it may not move
};

// λ D, one number per column.
Eigen::VectorXd damping_diagonal(const DenseSystem& system, const linear::Damping& damping);

// JᵀJ + λD.
Eigen::MatrixXd damped_matrix(const DenseSystem& system, const linear::Damping& damping);

// The minimum of ‖r − J δ‖² + ‖√(λD) δ‖², by QR of [J; √(λD)].
Eigen::VectorXd solve_by_qr(const DenseSystem& system, const linear::Damping& damping);

// ½‖r‖² − ½‖r − J δ‖².
double model_decrease(const DenseSystem& system, const Eigen::VectorXd& step);

// A step of the solver in the columns of the dense system; NaN if the solve failed.
Eigen::VectorXd flatten(const DenseSystem& system, const linear::Step& step);

// `matrix` over the first columns of the dense system, with zeros outside the diagonal blocks: the
// variable blocks of the cameras, and the points.
Eigen::MatrixXd block_diagonal(const linear::ParameterMap& map,
                               const DenseSystem& system,
                               const Eigen::MatrixXd& matrix);

// Of the free unknowns; what may not move stays.
linear::Step random_step(const linear::ParameterMap& map, unsigned seed);

}  // namespace sfmcpp::support

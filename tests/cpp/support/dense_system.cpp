#include "support/dense_system.hpp"

#include <limits>
#include <random>

#include <Eigen/QR>

namespace sfmcpp::support {

Eigen::VectorXd damping_diagonal(const DenseSystem& system, const linear::Damping& damping) {
  const Eigen::Index n = system.jacobian.cols();
  if (damping.matrix == linear::DampingMatrix::kIdentity) {
    return Eigen::VectorXd::Constant(n, damping.lambda);
  }
  const Eigen::VectorXd diagonal = system.jacobian.colwise().squaredNorm();
  return damping.lambda * diagonal.cwiseMax(1e-6).cwiseMin(1e32);
}

Eigen::MatrixXd damped_matrix(const DenseSystem& system, const linear::Damping& damping) {
  Eigen::MatrixXd matrix = system.jacobian.transpose() * system.jacobian;
  matrix.diagonal() += damping_diagonal(system, damping);
  return matrix;
}

Eigen::VectorXd solve_by_qr(const DenseSystem& system, const linear::Damping& damping) {
  const Eigen::Index m = system.jacobian.rows(), n = system.jacobian.cols();
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(m + n, n);
  a.topRows(m) = system.jacobian;
  a.bottomRows(n).diagonal() = damping_diagonal(system, damping).cwiseSqrt();
  Eigen::VectorXd b = Eigen::VectorXd::Zero(m + n);
  b.head(m) = system.residual;
  // Columns of length one: radians, metres and distortion coefficients differ by many powers of
  // ten.
  const Eigen::VectorXd scale = a.colwise().norm().cwiseInverse();
  return scale.cwiseProduct((a * scale.asDiagonal()).householderQr().solve(b));
}

double model_decrease(const DenseSystem& system, const Eigen::VectorXd& step) {
  const Eigen::VectorXd after = system.residual - system.jacobian * step;
  return 0.5 * (system.residual.squaredNorm() - after.squaredNorm());
}

Eigen::VectorXd flatten(const DenseSystem& system, const linear::Step& step) {
  Eigen::VectorXd flat =
      Eigen::VectorXd::Constant(system.jacobian.cols(), std::numeric_limits<double>::quiet_NaN());
  if (step.point.size() != 3 * system.point_column.size()) return flat;  // of a solve that failed
  for (int k = 0; k < system.camera_columns; ++k) flat[k] = step.camera[k];
  for (std::size_t p = 0; p < system.point_column.size(); ++p) {
    for (int k = 0; k < 3; ++k) {
      if (system.point_column[p] >= 0) flat[system.point_column[p] + k] = step.point[3 * p + k];
    }
  }
  return flat;
}

Eigen::MatrixXd block_diagonal(const linear::ParameterMap& map,
                               const DenseSystem& system,
                               const Eigen::MatrixXd& matrix) {
  const auto block_of = [&](Eigen::Index k) {
    return k < system.camera_columns
               ? map.block_of[k]
               : map.num_blocks() + static_cast<int>(k - system.camera_columns) / 3;
  };
  Eigen::MatrixXd blocks = matrix;
  for (Eigen::Index c = 0; c < matrix.cols(); ++c) {
    for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
      if (block_of(r) != block_of(c)) blocks(r, c) = 0.0;
    }
  }
  return blocks;
}

linear::Step random_step(const linear::ParameterMap& map, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  linear::Step step;
  for (int k = 0; k < map.num_columns; ++k) step.camera.push_back(normal(random));
  for (char free : map.free_point) {
    for (int k = 0; k < 3; ++k) step.point.push_back(free ? normal(random) : 0.0);
  }
  return step;
}

}  // namespace sfmcpp::support

// The algebraic error of a problem along a step, observation by observation at the matrices P + x
// ΔP and points Q + y ΔQ: the definition (thesis eqs 4.8–4.14), without the nine sums.
#pragma once

#include <vector>

#include <Eigen/Core>

#include "sfmcpp/ba/algebraic_cost.hpp"
#include "sfmcpp/residuals/loss.hpp"
#include "support/linearized_problem.hpp"
#include "support/uncalibrated.hpp"

namespace sfmcpp::support {

class AlgebraicReference {
 public:
  AlgebraicReference(const LinearizedProblem& work,
                     const linear::Step& step,
                     ba::AlgebraicWeights weights,
                     const Loss& loss = {});

  // Two per observation, over σ and with the root of the loss' derivative.
  Eigen::VectorXd residuals(double x, double y) const;
  double cost(double x, double y) const { return 0.5 * residuals(x, y).squaredNorm(); }

 private:
  struct Observation {
    Matrix34 p, dp;
    Eigen::Vector4d q, dq;
    Eigen::Matrix<double, 2, 3> s;  // the first two rows of [q̂]×, times the weight
  };
  std::vector<Observation> observations_;
};

// Where the pinhole of the camera that made observation k would have seen it, as exactly as the
// kernels ask for.
Eigen::Vector2d undistorted_pixel(const LinearizedProblem& work, int k);

// K of the camera that made observation k, and [Rᵀ | −Rᵀc] (metric models).
Matrix34 pinhole_matrix(const LinearizedProblem& work, int k);

}  // namespace sfmcpp::support

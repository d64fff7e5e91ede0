// The factor that whitens an observation, by Eigen.
#pragma once

#include <Eigen/Cholesky>

#include "sfmcpp/ba/problem.hpp"

namespace sfmcpp::support {

inline Eigen::Matrix2d whitening_factor(const double* covariance) {
  const Eigen::Map<const Eigen::Matrix2d> sigma(covariance);
  return sigma.llt().matrixL().solve(Eigen::Matrix2d::Identity());
}

inline Eigen::Matrix2d whitening_factor(const ba::Problem& problem, int k) {
  if (!problem.covariance_px2.empty())
    return whitening_factor(problem.covariance_px2.data() + 4L * k);
  const double sigma = problem.sigma_px.empty() ? 1.0 : problem.sigma_px[k];
  return Eigen::Matrix2d::Identity() / sigma;
}

}  // namespace sfmcpp::support

// Residuals that are linear in each of two lengths, whose squares are biquadratic costs.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include <Eigen/Dense>

#include "sfmcpp/math/biquadratic.hpp"

namespace sfmcpp::support {

using Eigen::VectorXd;
using Pair = std::array<double, 2>;

// The residual that the nine sums stand for.
struct BilinearResidual {
  VectorXd A, BP, BQ, C;

  VectorXd at(double x, double y) const { return A + x * BP + y * BQ + x * y * C; }
  double cost(double x, double y) const { return 0.5 * at(x, y).squaredNorm(); }
  Eigen::Vector2d gradient(double x, double y) const {
    return {at(x, y).dot(BP + y * C), at(x, y).dot(BQ + x * C)};
  }
  // Relative to the sizes of the vectors, whose products the sums are.
  double relative_gradient(double x, double y) const {
    const double x_size = std::abs(x), y_size = std::abs(y);
    const double p = BP.norm() + y_size * C.norm(), q = BQ.norm() + x_size * C.norm();
    const double r = A.norm() + x_size * BP.norm() + y_size * q;
    const Eigen::Vector2d g = gradient(x, y);
    return std::max(std::abs(g[0]) / (r * p), std::abs(g[1]) / (r * q));
  }
  Eigen::Matrix2d hessian(double x, double y) const {
    const VectorXd p = BP + y * C, q = BQ + x * C;
    const double mixed = p.dot(q) + at(x, y).dot(C);
    return (Eigen::Matrix2d() << p.squaredNorm(), mixed, mixed, q.squaredNorm()).finished();
  }
  // The y of least cost for an x.
  double best_point_length(double x) const {
    const VectorXd q = BQ + x * C;
    return -(A + x * BP).dot(q) / q.squaredNorm();
  }

  Biquadratic sums() const {
    return {.aa = A.dot(A),
            .ap = A.dot(BP),
            .aq = A.dot(BQ),
            .pp = BP.dot(BP),
            .qq = BQ.dot(BQ),
            .pq = BP.dot(BQ) + A.dot(C),
            .pc = BP.dot(C),
            .qc = BQ.dot(C),
            .cc = C.dot(C)};
  }
};

// As along a step: the residual shrinks near x = y = 1; C, of second order, is small or not. The
// fewer the components, the more stationary points.
inline BilinearResidual random_residual(unsigned seed, Eigen::Index components = 8) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const auto vector = [&](double size) {
    return VectorXd(size * VectorXd::NullaryExpr(components, [&] { return normal(random); }));
  };
  BilinearResidual r{vector(1.0), vector(1.0), vector(1.0), vector(std::pow(10.0, normal(random)))};
  if (seed % 2 == 0) r.A = vector(0.1) - r.BP - r.BQ - r.C;
  return r;
}

inline bool near(const Pair& a, const Pair& b, double relative) {
  return std::abs(a[0] - b[0]) <= relative * (1e-3 + std::abs(b[0])) &&
         std::abs(a[1] - b[1]) <= relative * (1e-3 + std::abs(b[1]));
}

}  // namespace sfmcpp::support

#include "sfmcpp/math/biquadratic.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

#include "sfmcpp/math/numeric_diff.hpp"
#include "support/bilinear_residual.hpp"

namespace sfmcpp::biquadratic_test {
namespace {

using Eigen::Vector2d;
using Eigen::VectorXd;
using support::near;
using support::Pair;
using support::random_residual;
using Residual = support::BilinearResidual;

constexpr unsigned kSeeds = 300;

TEST(Biquadratic, ValueAndGradientAreThoseOfTheResidual) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    const Residual r = random_residual(seed);
    const double x = 0.3 * seed - 2.0, y = 1.7 - 0.2 * seed;
    const auto cost = [&](const VectorXd& d) -> VectorXd {
      return VectorXd::Constant(1, r.cost(x + d[0], y + d[1]));
    };
    const auto numeric = numeric_jacobian(cost, Vector2d(1e-2, 1e-2));
    const auto [gx, gy] = r.sums().gradient(x, y);
    EXPECT_NEAR(r.sums().value(x, y), r.cost(x, y), 1e-13 * (1.0 + r.cost(x, y)));
    EXPECT_NEAR(gx, numeric(0, 0), 1e-8 * numeric.norm());
    EXPECT_NEAR(gy, numeric(0, 1), 1e-8 * numeric.norm());
  }
}

// For these seeds all lengths are within 50, and no two nearer to each other than an interval.
TEST(StationaryLengths, AreWhereTheSlopeChangesItsSign) {
  constexpr double kInterval = 0.01, kFarthest = 50.0;
  for (unsigned seed = 0; seed < 20; ++seed) {
    const Residual r = random_residual(seed, 3);
    const auto slope = [&](double a) { return r.gradient(a, a).sum(); };
    std::vector<double> changes;
    for (double a = -kFarthest; a < kFarthest; a += kInterval)
      if (slope(a) * slope(a + kInterval) < 0.0) changes.push_back(a);
    const std::vector<double> lengths = r.sums().stationary_lengths();
    ASSERT_EQ(lengths.size(), changes.size()) << "seed " << seed;
    for (std::size_t i = 0; i < lengths.size(); ++i) {
      EXPECT_GT(lengths[i], changes[i]);
      EXPECT_LT(lengths[i], changes[i] + kInterval);
      EXPECT_LT(slope(lengths[i] - 1e-9) * slope(lengths[i] + 1e-9), 0.0) << "seed " << seed;
    }
  }
}

TEST(StationaryPairs, HaveAVanishingGradient) {
  for (unsigned seed = 0; seed < kSeeds; ++seed) {
    const Residual r = random_residual(seed);
    for (const auto& [x, y] : r.sums().stationary_pairs())
      EXPECT_LT(r.relative_gradient(x, y), 1e-12) << "seed " << seed;
  }
}

std::vector<double> product(const std::vector<double>& a, const std::vector<double>& b) {
  std::vector<double> result(a.size() + b.size() - 1, 0.0);
  for (std::size_t i = 0; i < a.size(); ++i)
    for (std::size_t j = 0; j < b.size(); ++j) result[i + j] += a[i] * b[j];
  return result;
}

// The derivative of min_y F(x, y) = ½ ‖A + x B_P‖² − n²/2D, times D²; n and D are polynomials in x.
Eigen::Matrix<double, 6, 1> reduced_derivative(const Biquadratic& f) {
  const std::vector<double> n{f.aq, f.pq, f.pc}, n_slope{f.pq, 2.0 * f.pc};
  const std::vector<double> d{f.qq, 2.0 * f.qc, f.cc}, half_d_slope{f.qc, f.cc};
  const auto cameras = product({f.ap, f.pp}, product(d, d));
  const auto numerator = product(product(n, n_slope), d);
  const auto denominator = product(product(n, n), half_d_slope);
  Eigen::Matrix<double, 6, 1> result;
  for (std::size_t k = 0; k < 6; ++k)
    result[static_cast<Eigen::Index>(k)] = cameras[k] - numerator[k] + denominator[k];
  return result;
}

std::vector<double> real_eigenvalues_of_companion(const Eigen::Matrix<double, 6, 1>& c) {
  Eigen::MatrixXd companion = Eigen::MatrixXd::Zero(5, 5);
  companion.diagonal(-1).setOnes();
  companion.col(4) = -c.head(5) / c[5];
  std::vector<double> roots;
  for (const auto& root : companion.eigenvalues())
    if (std::abs(root.imag()) < 1e-10 * std::abs(root)) roots.push_back(root.real());
  std::ranges::sort(roots);
  return roots;
}

TEST(StationaryPairs, AreAllWhereTheReducedCostIsStationary) {
  std::array<int, 6> seen{};
  for (unsigned seed = 0; seed < kSeeds; ++seed) {
    const Residual r = random_residual(seed, 3 + seed % 4);
    const auto expected = real_eigenvalues_of_companion(reduced_derivative(r.sums()));
    const std::vector<Pair> pairs = r.sums().stationary_pairs();
    ASSERT_EQ(pairs.size(), expected.size()) << "seed " << seed;
    ++seen[pairs.size()];
    for (std::size_t i = 0; i < pairs.size(); ++i)
      EXPECT_NEAR(pairs[i][0], expected[i], 1e-7 * (1.0 + std::abs(expected[i])));
  }
  EXPECT_GT(seen[1], 10);
  EXPECT_GT(seen[3], 10);
  EXPECT_GT(seen[5], 0);
}

TEST(StationaryPairs, NewtonStepsFromAnywhereFindNoOthers) {
  int converged = 0;
  for (unsigned seed = 0; seed < 15; ++seed) {
    const Residual r = random_residual(seed);
    const std::vector<Pair> pairs = r.sums().stationary_pairs();
    for (int start = 0; start < 400; ++start) {
      Vector2d at(start % 20 - 9.5, start / 20 - 9.5);
      for (int i = 0; i < 40; ++i)
        at -= r.hessian(at[0], at[1]).inverse() * r.gradient(at[0], at[1]);
      if (!at.allFinite() || at.norm() > 1e4 || r.gradient(at[0], at[1]).norm() > 1e-10) continue;
      ++converged;
      const auto found = [&](const Pair& pair) { return near(pair, {at[0], at[1]}, 1e-6); };
      EXPECT_TRUE(std::ranges::any_of(pairs, found)) << "seed " << seed << " at " << at.transpose();
    }
  }
  EXPECT_GT(converged, 4000);
}

TEST(StationaryPairs, HoldTheGlobalMinimum) {
  for (unsigned seed = 0; seed < 60; ++seed) {
    const Residual r = random_residual(seed);
    double brute_force = std::numeric_limits<double>::infinity();
    for (double x = -100.0; x < 100.0; x += 1e-2)
      brute_force = std::min(brute_force, r.cost(x, r.best_point_length(x)));
    double least = std::numeric_limits<double>::infinity();
    for (const auto& [x, y] : r.sums().stationary_pairs()) least = std::min(least, r.cost(x, y));
    EXPECT_LE(least, brute_force) << "seed " << seed;
  }
}

// Longer steps have shorter lengths.
TEST(StationaryPairs, FollowTheScalesOfStepsAndResiduals) {
  for (unsigned seed = 0; seed < 50; ++seed) {
    const Residual r = random_residual(seed);
    const std::vector<Pair> expected = r.sums().stationary_pairs();
    for (const auto& [camera, point, cost] : {std::array{1e-10, 1e10, 1.0},
                                              std::array{1e10, 1e10, 1e-10},
                                              std::array{1e-5, 1e3, 1e10},
                                              std::array{1e-50, 1e-70, 1.0},
                                              std::array{1e60, 1e-60, 1e-20},
                                              std::array{1e-20, 1e-20, 1e20}}) {
      const Residual scaled{
          cost * r.A, cost * camera * r.BP, cost * point * r.BQ, cost * camera * point * r.C};
      const std::vector<Pair> pairs = scaled.sums().stationary_pairs();
      ASSERT_EQ(pairs.size(), expected.size()) << "seed " << seed;
      for (std::size_t i = 0; i < pairs.size(); ++i)
        EXPECT_TRUE(near({pairs[i][0] * camera, pairs[i][1] * point}, expected[i], 1e-9));
    }
  }
}

}  // namespace
}  // namespace sfmcpp::biquadratic_test

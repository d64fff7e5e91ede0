#include <algorithm>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "sfmcpp/math/biquadratic.hpp"
#include "support/bilinear_residual.hpp"

namespace sfmcpp::biquadratic_degenerate_test {
namespace {

using Eigen::Vector2d;
using support::near;
using support::Pair;
using support::random_residual;
using Residual = support::BilinearResidual;

// Close to the solution of a bundle adjustment nearly all of the residual is noise, and the best
// lengths are near 1.
TEST(StationaryPairs, AreFoundWhereTheStepChangesAlmostNothing) {
  for (unsigned seed = 0; seed < 50; ++seed) {
    Residual r = random_residual(2 * seed + 1);
    const double small = std::pow(10.0, -1.0 - seed % 6);
    r.BP *= small, r.BQ *= small, r.C *= small * small;
    // A noise that no step explains, and what the step takes away.
    const Eigen::MatrixXd steps = (Eigen::MatrixXd(8, 3) << r.BP, r.BQ, r.C).finished();
    r.A -= steps * steps.householderQr().solve(r.A);
    r.A -= r.BP + r.BQ + r.C;
    const std::vector<Pair> pairs = r.sums().stationary_pairs();
    const auto at_one = [](const Pair& pair) { return near(pair, {1.0, 1.0}, 1e-3); };
    EXPECT_TRUE(std::ranges::any_of(pairs, at_one)) << "seed " << seed;
  }
}

TEST(StationaryPairs, AreTheMinimumOfTheQuadraticWithoutSecondOrder) {
  Residual r = random_residual(5);
  r.C.setZero();
  const Eigen::MatrixXd J = (Eigen::MatrixXd(8, 2) << r.BP, r.BQ).finished();
  const Vector2d expected = -J.householderQr().solve(r.A);
  const std::vector<Pair> pairs = r.sums().stationary_pairs();
  ASSERT_EQ(pairs.size(), 1U);
  EXPECT_TRUE(near(pairs.front(), {expected[0], expected[1]}, 1e-12));
}

TEST(StationaryPairs, AreNoneWhereAWholeLineIsStationary) {
  Residual r = random_residual(6);
  r.C.setZero();
  r.BQ = -3.0 * r.BP;
  EXPECT_TRUE(r.sums().stationary_pairs().empty());
  r.BP.setZero(), r.BQ.setZero();
  EXPECT_TRUE(r.sums().stationary_pairs().empty());
}

TEST(StationaryPairs, LeaveTheLengthOfWhatDoesNotMoveAtOne) {
  Residual r = random_residual(8);
  r.C.setZero();
  Residual points_only = r, cameras_only = r;
  points_only.BP.setZero();
  cameras_only.BQ.setZero();
  const Pair best_y{1.0, -r.A.dot(r.BQ) / r.BQ.squaredNorm()};
  const Pair best_x{-r.A.dot(r.BP) / r.BP.squaredNorm(), 1.0};
  EXPECT_EQ(points_only.sums().stationary_pairs(), std::vector{best_y});
  EXPECT_EQ(cameras_only.sums().stationary_pairs(), std::vector{best_x});
}

// Without B_P the residual is linear in y and z = x y.
TEST(StationaryPairs, AreRightWhereTheCamerasActOnlyThroughThePoints) {
  for (double camera : {1.0, 1e-80, 1e80}) {
    Residual r = random_residual(9);
    r.BP.setZero();
    const Eigen::MatrixXd J = (Eigen::MatrixXd(8, 2) << r.BQ, r.C).finished();
    const Vector2d yz = -J.householderQr().solve(r.A);
    r.C *= camera;
    const std::vector<Pair> pairs = r.sums().stationary_pairs();
    const auto is_minimum = [&](const Pair& p) {
      return near({p[0] * camera, p[1]}, {yz[1] / yz[0], yz[0]}, 1e-10);
    };
    EXPECT_TRUE(std::ranges::any_of(pairs, is_minimum)) << "camera " << camera;
  }
}

// The leading coefficient of Υ vanishes: what rounding leaves of it must not become a root.
TEST(StationaryPairs, StayFiniteWhereTheSecondOrderIsParallelToTheCameras) {
  for (unsigned seed = 0; seed < 50; ++seed) {
    Residual r = random_residual(seed);
    r.C = 0.7 * r.BP;
    const std::vector<Pair> pairs = r.sums().stationary_pairs();
    EXPECT_FALSE(pairs.empty());
    for (const auto& [x, y] : pairs) {
      EXPECT_LT(r.relative_gradient(x, y), 1e-12);
      EXPECT_LT(std::abs(x), 1e6);
    }
  }
}

// At x = 2 the points' length changes nothing: the derivative of the reduced cost has a root of
// order four there, none of which is a minimum.
TEST(StationaryPairs, AreNotWhereThePointsLengthChangesNothing) {
  for (unsigned seed = 0; seed < 50; ++seed) {
    Residual r = random_residual(seed);
    r.BQ = -2.0 * r.C;
    const std::vector<Pair> pairs = r.sums().stationary_pairs();
    EXPECT_FALSE(pairs.empty());
    for (const auto& [x, y] : pairs) EXPECT_GT(std::abs(x - 2.0), 1e-3) << "seed " << seed;
  }
}

// Of two components, so that the sums hold cancellations: where rounding spoils the gradient there
// is no pair rather than a wrong one.
TEST(StationaryPairs, AreStationaryHoweverIllConditioned) {
  for (unsigned seed = 0; seed < 10000; ++seed) {
    const Residual r = random_residual(seed, 2);
    for (const auto& [x, y] : r.sums().stationary_pairs())
      ASSERT_LT(r.relative_gradient(x, y), 1e-8) << "seed " << seed;
  }
}

TEST(StationaryPairs, HoldTheStartWhereTheResidualIsZero) {
  Residual r = random_residual(11);
  r.A.setZero();
  EXPECT_EQ(r.sums().stationary_pairs().front(), (Pair{0.0, 0.0}));
}

TEST(Stationary, NumbersThatAreNotFiniteGiveNoPoints) {
  for (double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    Biquadratic sums = random_residual(12).sums();
    sums.pc = bad;
    EXPECT_TRUE(sums.stationary_pairs().empty());
    EXPECT_TRUE(sums.stationary_lengths().empty());
  }
}

}  // namespace
}  // namespace sfmcpp::biquadratic_degenerate_test

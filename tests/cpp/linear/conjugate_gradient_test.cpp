#include "sfmcpp/linear/conjugate_gradient.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <gtest/gtest.h>

namespace sfmcpp::linear::conjugate_gradient_test {
namespace {

using Eigen::Map;
using Eigen::MatrixXd;
using Eigen::VectorXd;

MatrixXd random_spd(int n, unsigned seed) {
  std::srand(seed);
  const MatrixXd a = MatrixXd::Random(n, n);
  return a * a.transpose() / n + MatrixXd::Identity(n, n);
}

LinearMap map_of(const MatrixXd& matrix) {
  return [matrix](const std::vector<double>& in, std::vector<double>& out) {
    const VectorXd product = matrix * Map<const VectorXd>(in.data(), matrix.cols());
    out.assign(product.begin(), product.end());
  };
}

ThreadPool pool(1);

const std::function<bool()> kGoOn = [] { return false; };

class RandomSystem : public testing::TestWithParam<int> {
 protected:
  int n = GetParam();
  MatrixXd a = random_spd(n, 3);
  std::vector<double> b = std::vector<double>(n, 1.0);
  std::vector<double> x;
  VectorXd residual() const { return VectorXd::Ones(n) - a * Map<const VectorXd>(x.data(), n); }
};

TEST_P(RandomSystem, ConvergesWithinAsManyIterationsAsUnknowns) {
  const auto result = ConjugateGradients(pool).solve(map_of(a),
                                                     map_of(MatrixXd::Identity(n, n)),
                                                     b,
                                                     {.tolerance = 1e-9, .max_iterations = n},
                                                     kGoOn,
                                                     x);
  EXPECT_LE(result.iterations, n);
  EXPECT_LT(residual().norm(), 1e-8 * std::sqrt(n));
}

TEST_P(RandomSystem, WithTheInverseAsPreconditionerTakesOneIteration) {
  const auto result = ConjugateGradients(pool).solve(
      map_of(a), map_of(a.inverse()), b, {.tolerance = 1e-8, .max_iterations = 10}, kGoOn, x);
  EXPECT_EQ(result.iterations, 1);
  EXPECT_LT(residual().norm(), 1e-8 * std::sqrt(n));
}

// ‖b − A x‖ in the norm of the preconditioner's inverse, against that of b.
TEST_P(RandomSystem, StopsAsSoonAsTheToleranceIsMetInTheNormItNames) {
  const MatrixXd m = a.diagonal().cwiseInverse().asDiagonal();
  const auto norm = [&](const VectorXd& v) { return std::sqrt(v.dot(m * v)); };
  const auto result = ConjugateGradients(pool).solve(
      map_of(a), map_of(m), b, {.tolerance = 1e-2, .max_iterations = 1000}, kGoOn, x);
  EXPECT_LE(norm(residual()), 1.0001e-2 * norm(VectorXd::Ones(n)));
  if (result.iterations == 0) return;
  ConjugateGradients(pool).solve(map_of(a),
                                 map_of(m),
                                 b,
                                 {.tolerance = 1e-2, .max_iterations = result.iterations - 1},
                                 kGoOn,
                                 x);
  EXPECT_GT(norm(residual()), 1e-2 * norm(VectorXd::Ones(n)));
}

INSTANTIATE_TEST_SUITE_P(Sizes, RandomSystem, testing::Values(1, 2, 10, 60));

TEST(ConjugateGradient, StopsSoonAfterItIsAsked) {
  const int n = 200;
  VectorXd spectrum = VectorXd::LinSpaced(n, 0.0, 6.0);
  for (double& value : spectrum) value = std::pow(10.0, value);
  const MatrixXd a = spectrum.asDiagonal(), identity = MatrixXd::Identity(n, n);
  const std::vector<double> b(n, 1.0);
  std::vector<double> x;
  int asked = 0;
  const auto at_third_time = [&] { return ++asked == 3; };
  const auto result = ConjugateGradients(pool).solve(map_of(a),
                                                     map_of(identity),
                                                     b,
                                                     {.tolerance = 1e-14, .max_iterations = 1000},
                                                     at_third_time,
                                                     x);
  EXPECT_EQ(asked, 3);
  EXPECT_LT(result.iterations, 60);
  EXPECT_GT(result.iterations, 0);
}

// i (Qᵢ − Qᵢ₋₁) < forcing · Qᵢ, with Q from the iterates themselves.
TEST(ConjugateGradient, StopsAtTheFirstIterationThatTheForcingSequenceFindsTooPoor) {
  const int n = 60;
  const MatrixXd a = random_spd(n, 7);
  const MatrixXd identity = MatrixXd::Identity(n, n);
  std::vector<double> b(n), x;
  for (int k = 0; k < n; ++k) b[k] = std::sin(k);
  const auto model_after = [&](int iterations) {
    ConjugateGradients(pool).solve(map_of(a),
                                   map_of(identity),
                                   b,
                                   {.tolerance = 1e-14, .max_iterations = iterations},
                                   kGoOn,
                                   x);
    const Map<const VectorXd> at(x.data(), n), rhs(b.data(), n);
    return 0.5 * at.dot(a * at) - rhs.dot(at);
  };
  const double forcing = 0.05;
  const auto result = ConjugateGradients(pool).solve(
      map_of(a), map_of(identity), b, {.tolerance = 1e-14, .forcing = forcing}, kGoOn, x);
  int expected = 1;
  while (expected * (model_after(expected) - model_after(expected - 1)) / model_after(expected) >=
         forcing)
    ++expected;
  EXPECT_EQ(result.iterations, expected);
  EXPECT_LT(result.iterations, n);
}

TEST(ConjugateGradient, OfAZeroRightHandSideIsZeroAtOnce) {
  std::vector<double> x(4, 7.0);
  const MatrixXd a = random_spd(4, 1);
  const auto result = ConjugateGradients(pool).solve(
      map_of(a), map_of(a), std::vector<double>(4, 0.0), {.tolerance = 1e-6}, kGoOn, x);
  EXPECT_EQ(result.iterations, 0);
  EXPECT_TRUE(result.finite);
  EXPECT_EQ(x, std::vector<double>(4, 0.0));
}

TEST(ConjugateGradient, SaysSoWhenTheRightHandSideIsNotFinite) {
  std::vector<double> x;
  const MatrixXd a = random_spd(3, 1);
  const std::vector<double> b{1.0, std::nan(""), 0.0};
  EXPECT_FALSE(
      ConjugateGradients(pool)
          .solve(map_of(a), map_of(a), b, {.tolerance = 1e-6, .max_iterations = 10}, kGoOn, x)
          .finite);
}

}  // namespace
}  // namespace sfmcpp::linear::conjugate_gradient_test

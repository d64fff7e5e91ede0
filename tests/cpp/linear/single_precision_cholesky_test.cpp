// A factor in single precision, of any size.
#include "../../../cpp/src/linear/single_precision_cholesky.hpp"

#include <random>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

namespace sfmcpp::linear::narrow_cholesky_test {
namespace {

Eigen::MatrixXd positive_definite(int size) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  const Eigen::MatrixXd a =
      Eigen::MatrixXd::NullaryExpr(size, size, [&] { return normal(random); });
  return a * a.transpose() + size * Eigen::MatrixXd::Identity(size, size);
}

SinglePrecisionCholesky factor_of(const Eigen::MatrixXd& matrix) {
  ThreadPool alone(1);
  const auto size = static_cast<int>(matrix.rows());
  DenseCholesky cholesky(size);
  cholesky.set_zero(alone);
  for (int c = 0; c < size; ++c) {
    for (int r = c; r < size; ++r) cholesky.at(r, c) = matrix(r, c);
  }
  EXPECT_TRUE(cholesky.factorize(alone));
  SinglePrecisionCholesky narrow;
  narrow.set(cholesky);
  return narrow;
}

Eigen::VectorXd solved(const SinglePrecisionCholesky& factor, const Eigen::VectorXd& x) {
  Eigen::VectorXd padded = Eigen::VectorXd::Zero(factor.padded_size());
  padded.head(x.size()) = x;
  factor.solve(padded.data());
  EXPECT_EQ(padded.tail(padded.size() - x.size()).norm(), 0.0);
  return padded.head(x.size());
}

class SinglePrecisionCholeskyOf : public testing::TestWithParam<int> {};

TEST_P(SinglePrecisionCholeskyOf, SolvesAsTheFactorDoesButForItsRounding) {
  const Eigen::MatrixXd matrix = positive_definite(GetParam());
  const Eigen::VectorXd x = Eigen::VectorXd::LinSpaced(GetParam(), -1.0, 2.0);
  const Eigen::VectorXd expected = matrix.llt().solve(x);
  EXPECT_LT((solved(factor_of(matrix), x) - expected).norm(), 1e-6 * expected.norm());
}

// Not rounded on the way, as in single precision: what comes by a rounding more, goes by as much.
TEST_P(SinglePrecisionCholeskyOf, IsLinearToTheLastDigits) {
  const SinglePrecisionCholesky factor = factor_of(positive_definite(GetParam()));
  const Eigen::VectorXd x = Eigen::VectorXd::LinSpaced(GetParam(), -1.0, 2.0);
  Eigen::VectorXd moved = x;
  moved[GetParam() / 2] += 1e-9;
  const Eigen::VectorXd change = solved(factor, moved) - solved(factor, x);
  const Eigen::VectorXd expected = solved(factor, moved - x);
  EXPECT_LT((change - expected).norm(), 1e-5 * expected.norm());
}

INSTANTIATE_TEST_SUITE_P(Sizes,
                         SinglePrecisionCholeskyOf,
                         testing::Values(1, 7, 8, 9, 24, 100, 181));

}  // namespace
}  // namespace sfmcpp::linear::narrow_cholesky_test

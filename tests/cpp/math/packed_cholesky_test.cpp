// Against Eigen's factorisation of the same matrix.
#include "sfmcpp/math/packed_cholesky.hpp"

#include <limits>
#include <random>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

namespace sfmcpp::packed_cholesky_test {
namespace {

using Matrix = Eigen::Matrix<double, 6, 6>;
using Vector = Eigen::Matrix<double, 6, 1>;
using Cholesky = PackedCholesky<6>;

Matrix random_spd(unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const Matrix m = Matrix::NullaryExpr([&] { return normal(random); });
  return m * m.transpose() + 0.1 * Matrix::Identity();
}

Cholesky::Lower packed(const Matrix& m) {
  Cholesky::Lower lower;
  int next = 0;
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column <= row; ++column) lower[next++] = m(row, column);
  }
  return lower;
}

TEST(PackedCholesky, SolvesLikeADenseFactorisation) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const Matrix m = random_spd(seed);
    const Vector b = Vector::LinSpaced(-1.0, 2.0);
    const Cholesky cholesky(packed(m));
    ASSERT_TRUE(cholesky.positive());
    Cholesky::Vector x;
    Vector::Map(x.data()) = b;
    x = cholesky.solve(x);
    EXPECT_LT((m * Vector::Map(x.data()) - b).norm(), 1e-11);
  }
}

TEST(PackedCholesky, InverseFactorWhitens) {
  const Matrix m = random_spd(5);
  const Cholesky::Lower lower = Cholesky(packed(m)).inverse_factor();
  Matrix inverse = Matrix::Zero();
  int next = 0;
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column <= row; ++column) inverse(row, column) = lower[next++];
  }
  EXPECT_LT((inverse * m * inverse.transpose() - Matrix::Identity()).norm(), 1e-12);
}

TEST(PackedCholesky, NoticesAMatrixThatIsNotPositive) {
  Matrix m = random_spd(6);
  m(4, 4) = -1.0;
  EXPECT_FALSE(Cholesky(packed(m)).positive());
  EXPECT_FALSE(Cholesky(packed(Matrix::Zero())).positive());
  m(4, 4) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(Cholesky(packed(m)).positive());
}

}  // namespace
}  // namespace sfmcpp::packed_cholesky_test

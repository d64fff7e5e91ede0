#include "sfmcpp/linear/dense_cholesky.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "support/instruction_sets.hpp"
#include "support/random_blocks.hpp"

namespace sfmcpp::linear::cholesky_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Diagonally dominant, hence positive definite.
MatrixXd random_spd(int n, unsigned seed) {
  std::srand(seed);
  const MatrixXd a = MatrixXd::Random(n, n);
  return 0.5 * (a + a.transpose()) + n * MatrixXd::Identity(n, n);
}

class DenseCholeskySizes : public testing::TestWithParam<int> {};

// To the lower triangle of a.
void set(const MatrixXd& a, DenseCholesky& cholesky) {
  for (int c = 0; c < a.cols(); ++c) {
    for (int r = c; r < a.rows(); ++r) cholesky.at(r, c) = a(r, c);
  }
}

DenseCholesky factored(const MatrixXd& a, ThreadPool& pool) {
  DenseCholesky cholesky(static_cast<int>(a.rows()));
  set(a, cholesky);
  EXPECT_TRUE(cholesky.factorize(pool));
  return cholesky;
}

// x ← a⁻¹ x of the leading rows.
void solve(const DenseCholesky& cholesky, int rows, VectorXd& x) {
  std::vector<double> padded(cholesky.padded_size(), std::nan(""));
  std::copy_n(x.data(), rows, padded.begin());
  cholesky.solve(padded, rows);
  std::copy_n(padded.begin(), rows, x.data());
}

// x ← a⁻¹ x from the lower triangle of a; false: refused.
bool solve_dense(const MatrixXd& a,
                 VectorXd& x,
                 ThreadPool& pool,
                 const CholeskyKernels& kernels = cholesky_kernels()) {
  const int n = static_cast<int>(a.rows());
  DenseCholesky cholesky(n, kernels);
  set(a, cholesky);
  if (!cholesky.factorize(pool)) return false;
  solve(cholesky, n, x);
  return true;
}

TEST_P(DenseCholeskySizes, SolvesLikeEigenOnEveryInstructionSet) {
  const int n = GetParam();
  ThreadPool pool(1);
  const MatrixXd a = random_spd(n, 5);
  const VectorXd b = VectorXd::LinSpaced(n, -1.0, 2.0), expected = a.llt().solve(b);
  for (const support::InstructionSet& set : support::instruction_sets()) {
    VectorXd x = b;
    ASSERT_TRUE(solve_dense(a, x, pool, set.cholesky())) << set.name;
    EXPECT_LT((x - expected).norm(), 1e-10 * expected.norm()) << set.name;
  }
}

TEST_P(DenseCholeskySizes, SolvesAgainAfterBeingSetToZero) {
  const int n = GetParam();
  ThreadPool pool(2);
  DenseCholesky cholesky(n);
  for (double diagonal : {2.0, 5.0}) {
    cholesky.set_zero(pool);
    for (int k = 0; k < n; ++k) cholesky.at(k, k) = diagonal;
    VectorXd x = VectorXd::Ones(n);
    ASSERT_TRUE(cholesky.factorize(pool));
    solve(cholesky, n, x);
    EXPECT_LT((diagonal * x - VectorXd::Ones(n)).norm(), 1e-14 * n);
  }
}

TEST_P(DenseCholeskySizes, HasTheSameBitsForEveryNumberOfThreads) {
  const int n = GetParam();
  const MatrixXd a = random_spd(n, 7);
  VectorXd reference;
  for (int threads : {1, 2, 3, 5}) {
    ThreadPool pool(threads);
    VectorXd x = VectorXd::LinSpaced(n, 1.0, 2.0);
    ASSERT_TRUE(solve_dense(a, x, pool));
    if (threads == 1) reference = x;
    EXPECT_EQ(x, reference) << threads << " threads";
  }
}

TEST_P(DenseCholeskySizes, GivesProductsWithTheInverseOfSparseColumns) {
  const int n = GetParam();
  ThreadPool pool(1);
  const MatrixXd a = random_spd(n, 6);
  const DenseCholesky cholesky = factored(a, pool);
  for (int first : {0, n / 2, n - 1}) {
    MatrixXd b = MatrixXd::Zero(n, 2);
    b(first, 0) = 2.0;
    b(n - 1, 1) = 1.0;
    const MatrixXd found = cholesky.inverse_product(support::entries_of(b), 2);
    const MatrixXd expected = b.transpose() * a.llt().solve(b);
    EXPECT_LT((found - expected).norm(), 1e-12 * expected.norm()) << first;
  }
}

TEST_P(DenseCholeskySizes, SolvesForTheLeadingRows) {
  const int n = GetParam();
  ThreadPool pool(2);
  const MatrixXd a = random_spd(n, 9);
  const DenseCholesky cholesky = factored(a, pool);
  for (int rows : {1, n / 2 + 1, n}) {
    VectorXd x = VectorXd::LinSpaced(rows, 1.0, 2.0);
    const VectorXd expected = a.topLeftCorner(rows, rows).llt().solve(x);
    solve(cholesky, rows, x);
    EXPECT_LT((x - expected).norm(), 1e-12 * expected.norm()) << rows;
  }
}

TEST_P(DenseCholeskySizes, SolvesForColumnsTogether) {
  const int n = GetParam();
  ThreadPool pool(2);
  const MatrixXd a = random_spd(n, 10);
  const DenseCholesky cholesky = factored(a, pool);
  MatrixXd x = MatrixXd::Random(n, 35);
  const MatrixXd expected = a.llt().solve(x);
  cholesky.solve(x, pool);
  EXPECT_LT((x - expected).norm(), 1e-12 * expected.norm());
}

TEST_P(DenseCholeskySizes, RefusesAMatrixThatIsNotPositiveDefinite) {
  const int n = GetParam();
  ThreadPool pool(2);
  for (int bad : {0, n / 2, n - 1}) {
    for (double pivot : {-1e3, 0.0, std::nan("")}) {
      MatrixXd a = random_spd(n, 8);
      a.row(bad).setZero();
      a.col(bad).setZero();
      a(bad, bad) = pivot;
      VectorXd x = VectorXd::Ones(n);
      EXPECT_FALSE(solve_dense(a, x, pool)) << "pivot " << bad << " = " << pivot;
    }
  }
}

// Every entry was no number then.
TEST_P(DenseCholeskySizes, IsSetAnewAfterARefusal) {
  const int n = GetParam();
  ThreadPool pool(2);
  const MatrixXd a = random_spd(n, 9);
  DenseCholesky cholesky(n);
  set(std::nan("") * a, cholesky);
  EXPECT_FALSE(cholesky.factorize(pool));
  set(a, cholesky);
  ASSERT_TRUE(cholesky.factorize(pool));
  VectorXd x = VectorXd::Ones(n);
  const VectorXd expected = a.llt().solve(x);
  solve(cholesky, n, x);
  EXPECT_LT((x - expected).norm(), 1e-10 * expected.norm());
}

// Around every size of panel, strip and tile, and beyond the size from which tasks grow.
INSTANTIATE_TEST_SUITE_P(
    Sizes,
    DenseCholeskySizes,
    testing::Values(1, 2, 7, 8, 9, 15, 16, 17, 63, 64, 65, 127, 129, 200, 257, 700, 1100));

TEST(DenseCholesky, OfNothingSucceeds) {
  ThreadPool pool(1);
  VectorXd nothing;
  EXPECT_TRUE(solve_dense(MatrixXd(0, 0), nothing, pool));
}

}  // namespace
}  // namespace sfmcpp::linear::cholesky_test

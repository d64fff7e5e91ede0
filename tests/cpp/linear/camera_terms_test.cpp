// The terms of residuals of one or two cameras against dense matrices over the reduced columns.
#include "sfmcpp/linear/camera_terms.hpp"

#include <random>

#include <Eigen/Core>
#include <gtest/gtest.h>

#include "sfmcpp/core/error.hpp"
#include "sfmcpp/linear/block_layout.hpp"

namespace sfmcpp::linear::camera_terms_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr int kCameras = 5;

// Camera 1 has lost two columns, camera 3 all; the last column of cameras 0 and 4 is one.
ParameterMap make_map(int size) {
  ParameterMap map;
  map.camera_size = size;
  for (int i = 0; i < kCameras; ++i) {
    for (int k = 0; k < size; ++k) {
      const bool gone = i == 3 || (i == 1 && k < 2);
      const bool shared = i == 4 && k == size - 1;
      map.column.push_back(gone ? kNoColumn : shared ? map.column[size - 1] : map.num_columns++);
    }
  }
  return map;
}

class CameraTermsOfSize : public testing::TestWithParam<int> {
 protected:
  CameraTermsOfSize() {
    // In both orders, one pair twice; cameras 0 and 4, which share a column, do not meet.
    for (const auto& [camera, other, rows] : std::vector<std::array<int, 3>>{
             {2, 0, 3}, {0, 2, 12}, {1, 4, 1}, {3, 4, 9}, {1, kNoCamera, 12}, {2, kNoCamera, 2}})
      add(camera, other, rows);
  }

  MatrixXd random(long rows, long columns) {
    return MatrixXd::NullaryExpr(rows, columns, [&] { return normal_(generator_); });
  }
  std::vector<double> random_vector() {
    const VectorXd x = random(map.num_columns, 1);
    return {x.begin(), x.end()};
  }

  void add(int camera, int other, int rows) {
    const RowMajor a = random(rows, map.camera_size), b = random(rows, map.camera_size);
    const VectorXd r = random(rows, 1);
    terms.add({rows, r.data(), camera, a.data(), other, other == kNoCamera ? nullptr : b.data()});
    MatrixXd jacobian = MatrixXd::Zero(rows, map.num_columns);
    place(a, camera, jacobian);
    if (other != kNoCamera) place(b, other, jacobian);
    matrix += jacobian.transpose() * jacobian;
    rhs += jacobian.transpose() * r;
  }

  void place(const RowMajor& block, int camera, MatrixXd& jacobian) const {
    for (int k = 0; k < map.camera_size; ++k) {
      const int column = map.columns_of(camera)[k];
      if (column != kNoColumn) jacobian.col(column) += block.col(k);
    }
  }

  static void expect_close(const std::vector<double>& actual, const VectorXd& expected) {
    const Eigen::Map<const VectorXd> values(actual.data(), expected.size());
    EXPECT_LT((values - expected).norm(), 1e-13 * expected.norm());
  }

  std::mt19937 generator_{7};
  std::normal_distribution<double> normal_;
  ParameterMap map = make_map(GetParam());
  CameraTerms terms{kCameras, GetParam(), {{2, 0}, {0, 2}, {4, 1}, {3, 4}, {1, 1}, {2, 2}}};
  MatrixXd matrix = MatrixXd::Zero(map.num_columns, map.num_columns);
  VectorXd rhs = VectorXd::Zero(map.num_columns);
};

TEST_P(CameraTermsOfSize, RightHandSideAndDiagonalAreAdded) {
  std::vector<double> sum(map.num_columns, 1.0), diagonal(map.num_columns, 1.0);
  terms.add_rhs(map, sum);
  terms.add_diagonal(map, diagonal);
  expect_close(sum, rhs.array() + 1.0);
  expect_close(diagonal, matrix.diagonal().array() + 1.0);
}

TEST_P(CameraTermsOfSize, ProductIsAdded) {
  const std::vector<double> x = random_vector();
  const Eigen::Map<const VectorXd> dense(x.data(), map.num_columns);
  std::vector<double> product(map.num_columns, 1.0);
  terms.add_product(map, x, product);
  expect_close(product, (matrix * dense).array() + 1.0);
  EXPECT_NEAR(terms.quadratic_form(map, x), dense.dot(matrix * dense), 1e-12 * matrix.norm());
}

TEST_P(CameraTermsOfSize, BlocksOfARowAscendFromTheDiagonalAndAreInPanelLayout) {
  const int size = map.camera_size;
  MatrixXd upper = MatrixXd::Zero(map.num_columns, map.num_columns);
  for (int i = 0; i < kCameras; ++i) {
    int last = i - 1;
    terms.for_each_block(i, [&](int j, const double* block) {
      EXPECT_GT(j, last);
      EXPECT_EQ(last == i - 1, j == i);
      last = j;
      for (int r = 0; r < size; ++r) {
        for (int c = 0; c < size; ++c) {
          const int row = map.columns_of(i)[r], column = map.columns_of(j)[c];
          if (row == kNoColumn || column == kNoColumn) continue;
          upper(row, column) += block[panel_index(size, r, c)];
          if (i != j) upper(column, row) += block[panel_index(size, r, c)];
        }
      }
    });
  }
  EXPECT_LT((upper - matrix).norm(), 1e-13 * matrix.norm());
}

TEST_P(CameraTermsOfSize, ZeroIsForgettingWhatWasAdded) {
  terms.set_zero();
  const std::vector<double> x = random_vector();
  EXPECT_EQ(terms.quadratic_form(map, x), 0.0);
  std::vector<double> sum(map.num_columns, 0.0);
  terms.add_rhs(map, sum);
  EXPECT_EQ(sum, std::vector<double>(map.num_columns, 0.0));
}

INSTANTIATE_TEST_SUITE_P(Sizes, CameraTermsOfSize, testing::Values(6, 9, 12, 18));

TEST(CameraTerms, PairsAreSortedOnceWithTheirDiagonals) {
  const CameraTerms terms(4, 6, {{3, 1}, {1, 3}, {0, 0}});
  EXPECT_EQ(terms.pairs(), (CameraPairs{{0, 0}, {1, 1}, {1, 3}, {3, 3}}));
}

TEST(CameraTerms, AResidualOfAPairThatWasNotAnnouncedIsRefused) {
  CameraTerms terms(4, 6, {{0, 1}, {2, 3}});
  const std::vector<double> zeros(6, 0.0);
  EXPECT_THROW(terms.add({1, zeros.data(), 1, zeros.data(), 2, zeros.data()}), Error);
}

TEST(CameraTerms, WithoutPairsThereIsNothing) {
  const CameraTerms terms(4, 6, {});
  EXPECT_TRUE(terms.empty());
  EXPECT_TRUE(terms.pairs().empty());
  int blocks = 0;
  terms.for_each_block(2, [&](int, const double*) { ++blocks; });
  EXPECT_EQ(blocks, 0);
}

}  // namespace
}  // namespace sfmcpp::linear::camera_terms_test

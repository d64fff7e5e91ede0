// The kernels of every instruction set, block size and precision against the formulas of
// schur_kernels.hpp in dense matrices, on a random graph. Coefficients are numbers that single
// precision holds, so that nothing is lost by storing them.
#include "sfmcpp/linear/schur_kernels.hpp"

#include <numeric>
#include <ostream>
#include <random>

#include <Eigen/Core>
#include <gtest/gtest.h>

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/linear/block_layout.hpp"
#include "sfmcpp/linear/observation_graph.hpp"
#include "support/instruction_sets.hpp"

namespace sfmcpp::linear::schur_kernels_test {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

struct Case {
  support::InstructionSet isa;
  int size;
  Precision stored;
};
void PrintTo(const Case& c, std::ostream* out) {
  *out << c.isa.name << " " << c.size << " " << enum_name(c.stored);
}

std::vector<Case> all_cases() {
  std::vector<Case> cases;
  for (const auto& isa : support::instruction_sets()) {
    for (int size : {6, 9, 12, 18}) {
      for (Precision stored : {Precision::kDouble, Precision::kSingle})
        cases.push_back({isa, size, stored});
    }
  }
  return cases;
}

AlignedVector<double> random_numbers(std::size_t count, std::mt19937& random) {
  std::normal_distribution<double> normal;
  AlignedVector<double> numbers(count);
  for (double& x : numbers) x = normal(random);
  return numbers;
}

class SchurKernel : public testing::TestWithParam<Case> {
 protected:
  static constexpr int kCameras = 5, kPoints = 40;
  static constexpr double kPower = 32.0;  // of a grid that bounds all sums

  SchurKernel() {
    std::bernoulli_distribution seen(0.6);
    std::normal_distribution<double> normal;
    std::vector<int> cameras, points;
    for (int i = 0; i < kCameras; ++i) {
      for (int p = 0; p < kPoints; ++p) {
        if (!seen(random)) continue;
        cameras.push_back(i);
        points.push_back(p);
      }
    }
    graph = make_observation_graph(kCameras, kPoints, cameras, points);
    count = graph.num_observations();
    jacobian.resize(2UL * count * size);
    for (double& x : jacobian) x = static_cast<float>(normal(random));
    records.resize(count);
    factors.resize(kPoints);
    for (PointRecord& record : records) {
      for (auto& [by_point, residual] : record.row) {
        for (double& x : by_point) x = static_cast<float>(normal(random));
        residual = static_cast<float>(normal(random));
      }
    }
    for (auto& [m00, m10, m11, m20, m21, m22, y] : factors) {
      for (double* x : {&m00, &m10, &m11, &m20, &m21, &m22, &y[0], &y[1], &y[2]})
        *x = normal(random);
    }
    narrow_jacobian.resize(jacobian.size());
    narrow_records.resize(8 * records.size());
    lost.resize(4UL * count);
    if (GetParam().stored == Precision::kDouble) return;
    kernels.round_jacobian(count, jacobian.data(), narrow_jacobian.data());
    kernels.round_records(count, records.data(), narrow_records.data(), lost.data());
  }

  StoredJacobian stored() const {
    if (GetParam().stored == Precision::kDouble) return {jacobian.data(), records.data()};
    return {narrow_jacobian.data(), narrow_records.data()};
  }

  MatrixXd j_of(int a) const {
    return Eigen::Map<const RowMajor>(&jacobian[2UL * a * size], 2, size);
  }
  MatrixXd record_of(int a) const {
    return Eigen::Map<const RowMajor>(records[a].row[0].by_point, 2, 4);
  }
  Matrix3d m_of(int p) const {
    const PointFactor& f = factors[p];
    Matrix3d m;
    m << f.m00, 0, 0, f.m10, f.m11, 0, f.m20, f.m21, f.m22;
    return m;
  }
  Vector3d y_of(int p) const { return Eigen::Map<const Vector3d>(factors[p].y); }
  MatrixXd g_of(int a) const { return record_of(a).leftCols(3) * m_of(graph.point[a]).transpose(); }
  // G | r̄.
  MatrixXd g_r_of(int a) const {
    MatrixXd result(2, 4);
    result << g_of(a), record_of(a).col(3) - g_of(a) * y_of(graph.point[a]);
    return result;
  }
  MatrixXd p_of(int a) const { return g_of(a).transpose() * j_of(a); }

  // Block (i, j) of S and the right-hand side Σ Jᵀ r̄ of camera i.
  MatrixXd expected_block(int i, int j) const {
    MatrixXd block = MatrixXd::Zero(size, size);
    for (int a = 0; a < count; ++a) {
      for (int b = 0; b < count; ++b) {
        if (graph.camera[a] != i || graph.camera[b] != j || graph.point[a] != graph.point[b])
          continue;
        if (i == j) block += j_of(a).transpose() * j_of(a);
        block -= p_of(a).transpose() * p_of(b);
      }
    }
    return block;
  }
  void append_pairs(int i, int j, std::vector<ObservationPair>& pairs) const {
    for (int a = graph.camera_begin[i]; a < graph.camera_begin[i + 1]; ++a) {
      for (int b = graph.camera_begin[j]; b < graph.camera_begin[j + 1]; ++b) {
        if (graph.point[a] == graph.point[b]) pairs.push_back({a, b});
      }
    }
  }
  VectorXd expected_rhs(int i) const {
    VectorXd rhs = VectorXd::Zero(size);
    for (int a = graph.camera_begin[i]; a < graph.camera_begin[i + 1]; ++a) {
      rhs += j_of(a).transpose() * g_r_of(a).col(3);
    }
    return rhs;
  }
  MatrixXd from_panels(const double* block) const {
    MatrixXd result(size, size);
    for (int r = 0; r < size; ++r) {
      for (int c = 0; c < size; ++c) result(r, c) = block[panel_index(size, r, c)];
    }
    return result;
  }

  static void expect_close(const MatrixXd& actual, const MatrixXd& expected) {
    ASSERT_TRUE(actual.allFinite());
    EXPECT_LT((actual - expected).cwiseAbs().maxCoeff(),
              1e-12 * (1.0 + expected.cwiseAbs().maxCoeff()));
  }
  DiagonalSum diagonal_of(int i) const {
    return {.begin = graph.camera_begin[i],
            .end = graph.camera_begin[i + 1],
            .point = graph.point.data(),
            .jacobian = stored(),
            .factors = factors.data(),
            .gradient = nullptr,
            .diagonal = nullptr,
            .rhs = nullptr};
  }
  void expect_numbers(const AlignedVector<double>& actual, const VectorXd& expected) {
    expect_close(Eigen::Map<const VectorXd>(actual.data(), expected.size()), expected);
  }

  int size = GetParam().size;
  SchurKernels kernels = GetParam().isa.schur(GetParam().size, GetParam().stored);
  std::mt19937 random{17};
  ObservationGraph graph;
  int count = 0;
  AlignedVector<double> jacobian;
  AlignedVector<PointRecord> records;
  AlignedVector<float> narrow_jacobian, narrow_records, lost;
  AlignedVector<PointFactor> factors;
};

TEST_P(SchurKernel, CameraGradientAddsGradientAndDiagonal) {
  VectorXd expected = VectorXd::Constant(size, 1.0), squares = VectorXd::Constant(size, 2.0);
  for (int a = 0; a < count; ++a) {
    expected += j_of(a).transpose() * record_of(a).col(3);
    squares += j_of(a).colwise().squaredNorm().transpose();
  }
  for (const auto kernel : {kernels.camera_gradient, kernels.compensated_gradient}) {
    AlignedVector<double> sums(4UL * size, 0.0);
    std::fill_n(sums.begin(), size, 1.0);
    std::fill_n(sums.begin() + size, size, 2.0);
    kernel(count, jacobian.data(), records.data(), sums.data());
    expect_numbers(sums, expected);
    expect_numbers({sums.begin() + size, sums.end()}, squares);
  }
}

// In twice the precision: with what is rounded off, the sum of numbers that cancel has its last
// digits too.
TEST_P(SchurKernel, CompensatedGradientKeepsWhatIsRoundedOff) {
  AlignedVector<double> sums(4UL * size, 0.0);
  std::fill_n(sums.begin(), size, 1e17);
  kernels.compensated_gradient(count, jacobian.data(), records.data(), sums.data());
  VectorXd expected = VectorXd::Zero(size);
  for (int a = 0; a < count; ++a) expected += j_of(a).transpose() * record_of(a).col(3);
  for (int k = 0; k < size; ++k)
    EXPECT_NEAR(
        (sums[k] - 1e17) + sums[2 * size + k], expected[k], 1e-12 * (1.0 + std::abs(expected[k])));
}

TEST_P(SchurKernel, SchurRowAddsTheBlocksBehindTheDiagonalOne) {
  for (int i = 0; i < kCameras; ++i) {
    std::vector<int> block_of_camera(kCameras);
    for (int j = 0; j < kCameras; ++j) block_of_camera[j] = j - i;
    const std::size_t area = static_cast<std::size_t>(size) * size;
    AlignedVector<double> blocks(area * (kCameras - i), 1.0);
    kernels.schur_row({.graph = graph.view(),
                       .begin = graph.camera_begin[i],
                       .end = graph.camera_begin[i + 1],
                       .jacobian = stored(),
                       .factors = factors.data(),
                       .block_of_camera = block_of_camera.data(),
                       .blocks = blocks.data()});
    for (int j = i + 1; j < kCameras; ++j) {
      expect_close(from_panels(&blocks[area * (j - i)]), expected_block(i, j).array() + 1.0);
    }
  }
}

TEST_P(SchurKernel, PairsByBlockAddTheSame) {
  if (kernels.sum_pairs == nullptr) GTEST_SKIP() << "too few registers for blocks of this size";
  const std::size_t area = static_cast<std::size_t>(size) * size;
  const AlignedVector<double> grid(static_cast<std::size_t>(size) * kCameras, kPower);
  for (const double* powers : {static_cast<const double*>(nullptr), grid.data()}) {
    AlignedVector<double> blocks(area * kCameras * kCameras, 1.0);
    AlignedVector<double> whitened(kWhitenedNumbers * count);
    std::vector<PairSums::Row> rows;
    std::vector<PairSums::Block> sums;
    std::vector<ObservationPair> pairs;
    for (int i = 0; i < kCameras; ++i) {
      const int first = graph.camera_begin[i];
      double* of_row = whitened.data() + kWhitenedNumbers * static_cast<long>(first);
      rows.push_back({first, graph.camera_begin[i + 1], of_row, powers});
    }
    for (int j = 0; j < kCameras; ++j) {
      for (int i = 0; i < j; ++i) {
        append_pairs(i, j, pairs);
        double* sum = &blocks[area * (kCameras * i + j)];
        sums.push_back({i, j, static_cast<long>(pairs.size()), sum});
      }
    }
    kernels.sum_pairs({.rows = rows,
                       .blocks = sums,
                       .pairs = pairs.data(),
                       .point = graph.point.data(),
                       .jacobian = stored(),
                       .factors = factors.data(),
                       .grid = powers});
    for (const PairSums::Block& sum : sums)
      expect_close(from_panels(sum.sum), expected_block(sum.row, sum.column).array() + 1.0);
  }
}

TEST_P(SchurKernel, SchurDiagonalIsTheDiagonalBlockAlone) {
  for (int i = 0; i < kCameras; ++i) {
    const AlignedVector<double> grid(static_cast<std::size_t>(size), kPower);
    for (const double* powers : {static_cast<const double*>(nullptr), grid.data()}) {
      AlignedVector<double> block(static_cast<std::size_t>(size) * size, std::nan(""));
      AlignedVector<double> rhs(2UL * size, std::nan(""));
      DiagonalSum sum = diagonal_of(i);
      sum.diagonal = block.data();
      sum.rhs = rhs.data();
      sum.grid = powers;
      kernels.schur_diagonal(sum);
      expect_close(from_panels(block.data()), expected_block(i, i));
      expect_numbers(rhs, expected_rhs(i));
    }
  }
}

TEST_P(SchurKernel, AGradientThatIsGivenStandsForTheStoredResiduals) {
  const AlignedVector<double> gradient = random_numbers(size, random);
  AlignedVector<double> block(static_cast<std::size_t>(size) * size), rhs(size, std::nan(""));
  DiagonalSum sum = diagonal_of(1);
  sum.gradient = gradient.data();
  sum.diagonal = block.data();
  sum.rhs = rhs.data();
  kernels.schur_diagonal(sum);
  VectorXd expected = Eigen::Map<const VectorXd>(gradient.data(), size);
  for (int a = graph.camera_begin[1]; a < graph.camera_begin[2]; ++a)
    expected -= j_of(a).transpose() * g_of(a) * y_of(graph.point[a]);
  expect_numbers(rhs, expected);
}

TEST_P(SchurKernel, WhatRoundingTakesFromThePullOfAResidualIsKept) {
  if (GetParam().stored == Precision::kDouble) return;
  std::normal_distribution<double> normal;
  for (PointRecord& record : records) {
    for (auto& [by_point, residual] : record.row) {
      for (double& x : by_point) x = normal(random);
      residual = normal(random);
    }
  }
  kernels.round_records(count, records.data(), narrow_records.data(), lost.data());
  for (int a = 0; a < count; ++a) {
    const Eigen::Matrix<double, 2, 4> exact = record_of(a);
    const Eigen::Matrix<double, 2, 4> kept = exact.cast<float>().cast<double>();
    EXPECT_EQ(
        (Eigen::Map<const Eigen::Matrix<float, 2, 4, Eigen::RowMajor>>(&narrow_records[8UL * a]))
            .cast<double>(),
        kept);
    const Vector3d pull = exact.leftCols(3).transpose() * exact.col(3);
    const Vector3d of_kept = kept.leftCols(3).transpose() * kept.col(3);
    const Vector3d missing = Eigen::Map<const Eigen::Vector3f>(&lost[4UL * a]).cast<double>();
    EXPECT_LT((of_kept + missing - pull).norm(), 1e-14 * exact.squaredNorm());
  }
}

TEST_P(SchurKernel, PointSumsAddTheWhitenedStepsOfThePointsCameras) {
  const AlignedVector<double> steps =
      random_numbers(static_cast<std::size_t>(kCameras) * size, random);
  AlignedVector<double> sums(3UL * kPoints, std::nan(""));
  kernels.point_sums(graph.view(), 0, kPoints, stored(), factors.data(), steps.data(), sums.data());
  VectorXd expected = VectorXd::Zero(3L * kPoints);
  for (int a = 0; a < count; ++a) {
    const Eigen::Map<const VectorXd> step(&steps[static_cast<std::size_t>(size) * graph.camera[a]],
                                          size);
    expected.segment<3>(3L * graph.point[a]) += p_of(a) * step;
  }
  expect_numbers(sums, expected);
}

TEST_P(SchurKernel, SchurProductAddsWhatTheShiftedPointsLeaveOfTheStep) {
  const AlignedVector<double> x = random_numbers(size, random),
                              shifts = random_numbers(3UL * kPoints, random);
  AlignedVector<double> out(2UL * size, 3.0);
  kernels.schur_product(
      stored(), 0, count, graph.point.data(), shifts.data(), x.data(), out.data());
  for (int k = 0; k < size; ++k) out[k] += out[size + k] - 3.0;
  VectorXd expected = VectorXd::Constant(size, 3.0);
  for (int a = 0; a < count; ++a) {
    const Eigen::Map<const VectorXd> step(x.data(), size);
    const Eigen::Map<const Eigen::Vector3d> shift(&shifts[3UL * graph.point[a]]);
    expected += j_of(a).transpose() * (j_of(a) * step - record_of(a).leftCols(3) * shift);
  }
  expect_numbers(out, expected);
}

TEST_P(SchurKernel, CurvatureIsTheSquareOfWhatTheResidualsMove) {
  const AlignedVector<double> x = random_numbers(size, random),
                              shifts = random_numbers(3UL * kPoints, random);
  double expected = 0.0;
  for (int a = 0; a < count; ++a) {
    const Eigen::Map<const VectorXd> step(x.data(), size);
    const Eigen::Map<const Eigen::Vector3d> shift(&shifts[3UL * graph.point[a]]);
    expected += (j_of(a) * step + record_of(a).leftCols(3) * shift).squaredNorm();
  }
  CompensatedSum actual;
  kernels.curvature(stored(), 0, count, graph.point.data(), shifts.data(), x.data(), actual);
  EXPECT_NEAR(actual.value() / expected, 1.0, 1e-12);
}

INSTANTIATE_TEST_SUITE_P(Kernels, SchurKernel, testing::ValuesIn(all_cases()));

}  // namespace
}  // namespace sfmcpp::linear::schur_kernels_test

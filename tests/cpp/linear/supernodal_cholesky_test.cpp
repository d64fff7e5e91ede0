// The supernodal factorisation against dense factorisations by Eigen.
#include "sfmcpp/linear/supernodal_cholesky.hpp"

#include <cmath>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "sfmcpp/linear/reduced_structure.hpp"
#include "support/instruction_sets.hpp"
#include "support/random_blocks.hpp"

namespace sfmcpp::linear::supernodal_cholesky_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// A graph, its supernodes, and matrices of its pattern handed over block by block.
class Factored {
 public:
  explicit Factored(BlockGraph blocks, const CholeskyKernels& kernels = cholesky_kernels())
      : graph(std::move(blocks)),
        supernodes(make_supernodes(graph, support::ordered(graph))),
        cholesky(supernodes, kernels),
        first_(support::first_columns(graph)) {}

  bool factorize(const MatrixXd& matrix, ThreadPool& pool) {
    cholesky.set_zero(pool);
    for (int k = 0; k < static_cast<int>(graph.size.size()); ++k) copy(matrix, k, k);
    for (const auto& [a, b] : graph.edges) {
      const bool later = supernodes.position[a] > supernodes.position[b];
      copy(matrix, later ? a : b, later ? b : a);
    }
    return cholesky.factorize(pool);
  }
  VectorXd solve(const VectorXd& b, ThreadPool& pool) {
    VectorXd x = placed(b);
    cholesky.solve({x.data(), static_cast<std::size_t>(x.size())}, pool);
    return taken(x);
  }
  MatrixXd placed(const MatrixXd& x) const {
    MatrixXd y(x.rows(), x.cols());
    for_each_column([&](int from, int to) { y.row(to) = x.row(from); });
    return y;
  }
  MatrixXd taken(const MatrixXd& y) const {
    MatrixXd x(y.rows(), y.cols());
    for_each_column([&](int from, int to) { x.row(from) = y.row(to); });
    return x;
  }

  BlockGraph graph;
  Supernodes supernodes;
  SupernodalCholesky cholesky;

 private:
  template <class F>
  void for_each_column(const F& f) const {
    for (std::size_t k = 0; k < graph.size.size(); ++k) {
      for (int c = 0; c < graph.size[k]; ++c)
        f(first_[k] + c, supernodes.first_column[supernodes.position[k]] + c);
    }
  }
  void copy(const MatrixXd& matrix, int row, int column) {
    const BlockPlace at = cholesky.place(supernodes.position[row], supernodes.position[column]);
    for (int c = 0; c < graph.size[column]; ++c) {
      for (int r = row == column ? c : 0; r < graph.size[row]; ++r)
        cholesky.values()[at.of(r, c)] = matrix(first_[row] + r, first_[column] + c);
    }
  }

  std::vector<int> first_;
};

struct Pattern {
  const char* name;
  BlockGraph graph;
};

std::vector<Pattern> patterns() {
  BlockGraph apart = support::random_block_graph(4, 30, 0.1);
  apart.size.resize(40, 7);  // blocks that meet no other
  return {{"one block", {{5}, {}}},
          {"diagonal", support::random_block_graph(1, 20, 0.0)},
          {"random", support::random_block_graph(2, 60, 0.05)},
          {"denser", support::random_block_graph(3, 40, 0.3)},
          {"full", support::random_block_graph(5, 30, 1.0)},
          {"blocks apart", std::move(apart)},
          {"grid", support::grid_graph(18, 6)},
          {"grid and a block that all meet", support::grid_graph(16, 5, true)},
          {"wide blocks", support::grid_graph(4, 60)}};
}

TEST(SupernodalCholesky, SolvesLikeADenseFactorisationOnEveryInstructionSet) {
  ThreadPool pool(2);
  for (const auto& [name, graph] : patterns()) {
    const MatrixXd a = support::matrix_of(graph, 7);
    const VectorXd b = VectorXd::LinSpaced(a.rows(), -1.0, 2.0), expected = a.llt().solve(b);
    for (const support::InstructionSet& set : support::instruction_sets()) {
      Factored factored(graph, set.cholesky());
      ASSERT_TRUE(factored.factorize(a, pool)) << name << ", " << set.name;
      EXPECT_LT((factored.solve(b, pool) - expected).norm(), 1e-12 * expected.norm())
          << name << ", " << set.name;
    }
  }
}

TEST(SupernodalCholesky, SolvesForManyColumnsAndKnowsTheDeterminant) {
  ThreadPool pool(2);
  for (const auto& [name, graph] : patterns()) {
    const MatrixXd a = support::matrix_of(graph, 8);
    const Eigen::LLT<MatrixXd> llt(a);
    Factored factored(graph);
    ASSERT_TRUE(factored.factorize(a, pool));
    const MatrixXd identity = MatrixXd::Identity(a.rows(), a.rows());
    const MatrixXd b = identity(Eigen::all, Eigen::seq(0, Eigen::last, 13));
    MatrixXd x = factored.placed(b);
    factored.cholesky.solve(x, pool);
    EXPECT_LT((a * factored.taken(x) - b).norm(), 1e-10) << name;
    const double expected = 2.0 * MatrixXd(llt.matrixL()).diagonal().array().log().sum();
    EXPECT_NEAR(factored.cholesky.log_determinant(), expected, 1e-12 * a.rows() * 10) << name;
  }
}

// The work space is that of one product after the other, of fewer and of more columns.
TEST(SupernodalCholesky, GivesProductsWithTheInverseOfSparseColumns) {
  ThreadPool pool(2);
  for (const auto& [name, graph] : patterns()) {
    const MatrixXd a = support::matrix_of(graph, 8);
    Factored factored(graph);
    ASSERT_TRUE(factored.factorize(a, pool));
    const auto n = static_cast<int>(a.rows());
    SupernodalCholesky::HalfSolution work;
    for (int columns : {2, 3, 1}) {
      MatrixXd b = MatrixXd::Zero(n, columns);
      for (int c = 0; c < columns; ++c) b(n * c / columns, c) = 1.0 + c;
      b(n - 1, 0) += 0.5;
      const MatrixXd placed = factored.placed(b);
      const MatrixXd found =
          factored.cholesky.inverse_product(support::entries_of(placed), columns, work);
      const MatrixXd expected = b.transpose() * a.llt().solve(b);
      EXPECT_LT((found - expected).norm(), 1e-12 * expected.norm()) << name << ", " << columns;
      EXPECT_LT((found - found.transpose()).norm(), 1e-15 * expected.norm());
    }
  }
}

TEST(SupernodalCholesky, FactorsSeveralMatricesOfOnePatternAndRefusesThoseNotPositiveDefinite) {
  ThreadPool pool(2);
  for (const auto& [name, graph] : patterns()) {
    const MatrixXd good = support::matrix_of(graph, 9);
    const auto n = static_cast<int>(good.rows());
    Factored factored(graph);
    for (int bad : {0, n / 2, n - 1}) {
      for (double pivot : {-5.0, 0.0, std::nan("")}) {
        MatrixXd a = good;
        a(bad, bad) = pivot;
        EXPECT_FALSE(factored.factorize(a, pool)) << name << ", pivot " << bad << " = " << pivot;
      }
      ASSERT_TRUE(factored.factorize(good, pool)) << name;
      const VectorXd x = factored.solve(VectorXd::Ones(n), pool);
      EXPECT_LT((good * x - VectorXd::Ones(n)).norm(), 1e-12 * n) << name;
    }
  }
}

// Large enough for several sets of subtrees, and for supernodes above them.
TEST(SupernodalCholesky, HasTheSameBitsForEveryNumberOfThreads) {
  for (bool shared : {false, true}) {
    const BlockGraph graph = support::grid_graph(30, 6, shared);
    const MatrixXd a = support::matrix_of(graph, 10);
    VectorXd reference;
    for (int threads : {1, 2, 3, 5}) {
      ThreadPool pool(threads);
      Factored factored(graph);
      ASSERT_GE(factored.supernodes.subtrees.size(), 3u);
      ASSERT_GE(factored.supernodes.top.size(), 2u);
      ASSERT_TRUE(factored.factorize(a, pool));
      const VectorXd x = factored.solve(VectorXd::LinSpaced(a.rows(), 1.0, 2.0), pool);
      if (threads == 1) reference = x;
      EXPECT_EQ(x, reference) << threads << " threads";
      EXPECT_LT((a * x - VectorXd::LinSpaced(a.rows(), 1.0, 2.0)).norm(), 1e-10);
    }
  }
}

TEST(Supernodes, HoldEveryEntryOfTheFactorAndTheirRowsAreThoseOfTheTree) {
  for (const auto& [name, graph] : patterns()) {
    const BlockOrdering ordering = support::ordered(graph);
    const Supernodes s = make_supernodes(graph, ordering);
    double stored = 0.0;
    for (int k = 0; k < s.count(); ++k) {
      const double n = s.panel[k].columns;
      stored += n * (n + 1) / 2 + n * s.panel[k].height;
      if (s.rows_of(k).empty()) {
        EXPECT_EQ(s.parent[k], -1) << name;
      } else {
        EXPECT_EQ(s.parent[k], s.of_place[s.rows_of(k).front()]) << name;
      }
    }
    EXPECT_GE(stored, ordering.factor_entries) << name;
    EXPECT_GE(s.num_entries, stored) << name;
    EXPECT_GE(s.flops, ordering.flops * (1 - 1e-12)) << name;
  }
}

TEST(Supernodes, OfAFullMatrixAreOneWithoutZeros) {
  const BlockGraph graph = support::random_block_graph(5, 30, 1.0);
  const BlockOrdering ordering = support::ordered(graph);
  const Supernodes s = make_supernodes(graph, ordering);
  EXPECT_EQ(s.count(), 1);
  EXPECT_NEAR(s.flops, ordering.flops, 1e-9 * s.flops);
}

// 160,000 columns that all meet have 1.28e10 entries: six times what 31 bits count.
TEST(Supernodes, CountMoreEntriesThan31Bits) {
  BlockGraph graph;
  constexpr int kBlocks = 40, kSize = 4000;
  graph.size.assign(kBlocks, kSize);
  for (int a = 0; a < kBlocks; ++a) {
    for (int b = a + 1; b < kBlocks; ++b) graph.edges.emplace_back(a, b);
  }
  const BlockOrdering ordering = support::ordered(graph);
  constexpr std::int64_t kColumns = kBlocks * kSize;
  EXPECT_EQ(ordering.factor_entries, static_cast<double>(kColumns * (kColumns + 1) / 2));
  EXPECT_GE(make_supernodes(graph, ordering).num_entries, kColumns * kColumns);
}

}  // namespace
}  // namespace sfmcpp::linear::supernodal_cholesky_test

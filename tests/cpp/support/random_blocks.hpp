// Graphs of variable blocks, and positive definite matrices with their pattern.
#pragma once

#include <random>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "sfmcpp/linear/block_ordering.hpp"
#include "sfmcpp/linear/panel_cholesky.hpp"

namespace sfmcpp::support {

inline linear::BlockGraph random_block_graph(unsigned seed, int blocks, double density) {
  std::mt19937 random(seed);
  std::bernoulli_distribution coupled(density);
  linear::BlockGraph graph;
  for (int k = 0; k < blocks; ++k) graph.size.push_back(1 + static_cast<int>(random() % 9));
  for (int a = 0; a < blocks; ++a) {
    for (int b = a + 1; b < blocks; ++b) {
      if (coupled(random)) graph.edges.emplace_back(a, b);
    }
  }
  return graph;
}

inline linear::BlockOrdering ordered(const linear::BlockGraph& graph) {
  ThreadPool alone(1);
  return linear::order_blocks(graph, alone);
}

// A square of blocks that meet their neighbours, and, if asked for, one last block that all meet.
inline linear::BlockGraph grid_graph(int side, int size, bool shared = false) {
  linear::BlockGraph graph;
  graph.size.assign(side * side + (shared ? 1 : 0), size);
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const int block = side * y + x;
      if (x + 1 < side) graph.edges.emplace_back(block, block + 1);
      if (y + 1 < side) graph.edges.emplace_back(block, block + side);
      if (shared) graph.edges.emplace_back(block, side * side);
    }
  }
  return graph;
}

inline std::vector<int> first_columns(const linear::BlockGraph& graph) {
  std::vector<int> first{0};
  for (int size : graph.size) first.push_back(first.back() + size);
  return first;
}

// Diagonally dominant, blocks in the graph's own order.
inline Eigen::MatrixXd matrix_of(const linear::BlockGraph& graph, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  const std::vector<int> first = first_columns(graph);
  Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(first.back(), first.back());
  const auto fill = [&](int a, int b) {
    for (int c = first[a]; c < first[a + 1]; ++c) {
      for (int r = first[b]; r < first[b + 1]; ++r) {
        if (r != c) matrix(r, c) = matrix(c, r) = unit(random);
      }
    }
  };
  for (int k = 0; k < static_cast<int>(graph.size.size()); ++k) fill(k, k);
  for (const auto& [a, b] : graph.edges) fill(a, b);
  for (int k = 0; k < matrix.rows(); ++k) matrix(k, k) = matrix.row(k).cwiseAbs().sum() + 0.5;
  return matrix;
}

// What a matrix has that is not zero, column by column.
inline linear::SparseEntries entries_of(const Eigen::MatrixXd& matrix) {
  linear::SparseEntries entries;
  for (int c = 0; c < matrix.cols(); ++c) {
    for (int r = 0; r < matrix.rows(); ++r) {
      if (matrix(r, c) != 0.0) entries.emplace_back(r, c, matrix(r, c));
    }
  }
  return entries;
}

}  // namespace sfmcpp::support

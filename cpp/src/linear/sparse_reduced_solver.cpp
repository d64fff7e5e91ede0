#include <algorithm>
#include <cmath>

#include "sfmcpp/core/error.hpp"
#include "sfmcpp/linear/block_ordering.hpp"
#include "sfmcpp/linear/reduced_solver.hpp"
#include "sfmcpp/linear/sparse_cholesky.hpp"

namespace sfmcpp::linear {
namespace {

// Where an entry of the reduced system lies in the compressed columns, in elimination order.
class BlockCompressed {
 public:
  BlockCompressed(const BlockGraph& graph, const BlockOrdering& ordering, const ParameterMap& map)
      : map_(map), position_(ordering.position) {
    place_blocks(graph);
    fill_pattern();
  }

  SparseLower& matrix() { return matrix_; }
  int place(int column) const {
    const int block = map_.block_of[column];
    return first_[position_[block]] + column - map_.block_begin[block];
  }

  // The pair of blocks that an entry fell into last, and where its rows begin in the columns.
  struct Pair {
    int row_block = -1, column_block = -1, offset = 0;
  };

  // Consecutive entries mostly fall into the same pair of blocks: its place is kept in `last`.
  void add(int row, int column, double value, Pair& last) {
    int r = place(row), c = place(column);
    int row_block = position_[map_.block_of[row]], column_block = position_[map_.block_of[column]];
    if (r < c) {
      std::swap(r, c);
      std::swap(row_block, column_block);
    }
    if (row_block != last.row_block || column_block != last.column_block) {
      last = look_up(row_block, column_block);
    }
    // Column c starts at its diagonal entry; rows before c of its own block are not stored.
    const int skipped = c - first_[column_block];
    matrix_.value[matrix_.column_begin[c] + last.offset - skipped + (r - first_[row_block])] +=
        value;
  }

 private:
  void place_blocks(const BlockGraph& graph) {
    const std::size_t n = graph.size.size();
    size_.resize(n);
    rows_.resize(n);
    for (std::size_t k = 0; k < n; ++k) {
      size_[position_[k]] = graph.size[k];
      rows_[k].push_back(static_cast<int>(k));
    }
    for (const auto& [a, b] : graph.edges) {
      const auto [low, high] = std::minmax(position_[a], position_[b]);
      rows_[low].push_back(high);
    }
    first_.assign(n + 1, 0);
    for (std::size_t k = 0; k < n; ++k) {
      first_[k + 1] = first_[k] + size_[k];
      std::sort(rows_[k].begin(), rows_[k].end());
    }
  }

  void fill_pattern() {
    matrix_.size = first_.back();
    for (std::size_t block = 0; block < size_.size(); ++block) {
      for (int c = first_[block]; c < first_[block + 1]; ++c) {
        matrix_.column_begin.push_back(static_cast<int>(matrix_.row.size()));
        for (int row_block : rows_[block]) {
          for (int r = std::max(c, first_[row_block]); r < first_[row_block + 1]; ++r)
            matrix_.row.push_back(r);
        }
      }
    }
    matrix_.column_begin.push_back(static_cast<int>(matrix_.row.size()));
    matrix_.value.resize(matrix_.row.size());
  }

  Pair look_up(int row_block, int column_block) const {
    Pair pair{row_block, column_block, 0};
    for (int block : rows_[column_block]) {
      if (block == row_block) return pair;
      pair.offset += size_[block];
    }
    throw Error("an entry of the reduced system lies outside its analysed pattern");
  }

  const ParameterMap& map_;
  std::vector<int> position_;
  std::vector<int> size_;   // by place
  std::vector<int> first_;  // first column of each block, by place
  std::vector<std::vector<int>>
      rows_;  // blocks on and below the diagonal of a block column, by place
  SparseLower matrix_;
};

class SparseReducedSolver final : public ReducedSolver {
 public:
  SparseReducedSolver(const CameraPattern& pattern,
                      const ParameterMap& map,
                      const BlockGraph& graph)
      : pattern_(pattern),
        map_(map),
        compressed_(graph, order_blocks(graph), map),
        cholesky_(make_sparse_cholesky(compressed_.matrix())) {}

  void start(const std::vector<double>& diagonal) override {
    std::vector<double>& values = compressed_.matrix().value;
    std::fill(values.begin(), values.end(), 0.0);
    BlockCompressed::Pair last;
    for (int k = 0; k < map_.num_columns; ++k) compressed_.add(k, k, diagonal[k], last);
  }

  void add_row(int i, const double* row_blocks) override {
    BlockCompressed::Pair last;
    for_each_reduced_entry(pattern_, map_, i, row_blocks, [&](int row, int column, double value) {
      compressed_.add(row, column, value, last);
    });
  }

  bool factorize() override { return cholesky_->factorize(compressed_.matrix()); }

  bool solve(std::vector<double>& x) override {
    std::vector<double> placed(x.size());
    for (int k = 0; k < map_.num_columns; ++k) placed[compressed_.place(k)] = x[k];
    cholesky_->solve(placed);
    for (int k = 0; k < map_.num_columns; ++k) x[k] = placed[compressed_.place(k)];
    return std::all_of(x.begin(), x.end(), [](double value) { return std::isfinite(value); });
  }

 private:
  const CameraPattern& pattern_;
  const ParameterMap& map_;
  BlockCompressed compressed_;
  std::unique_ptr<SparseCholesky> cholesky_;
};

}  // namespace

std::unique_ptr<ReducedSolver> make_sparse_reduced_solver(const CameraPattern& pattern,
                                                          const ParameterMap& map) {
  return std::make_unique<SparseReducedSolver>(pattern, map, make_block_graph(pattern, map));
}

}  // namespace sfmcpp::linear

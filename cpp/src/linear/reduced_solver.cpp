#include "reduced_solver.hpp"

#include <algorithm>
#include <cmath>

#include "sfmcpp/linear/block_layout.hpp"
#include "sfmcpp/linear/dense_cholesky.hpp"
#include "sfmcpp/linear/supernodal_cholesky.hpp"

namespace sfmcpp::linear {
namespace {

// That pass between ranks.
constexpr std::size_t kNumbersAtATime = std::size_t{1} << 16;

template <class Place>
SparseEntries entries_of(const Eigen::SparseMatrix<double>& x, const Place& place) {
  SparseEntries entries;
  for (int column = 0; column < x.outerSize(); ++column) {
    for (Eigen::SparseMatrix<double>::InnerIterator e(x, column); e; ++e)
      entries.emplace_back(place(static_cast<int>(e.row())), column, e.value());
  }
  return entries;
}

class DenseReducedSolver final : public ReducedSolver {
 public:
  DenseReducedSolver(const ReducedStructure& structure, const ParameterMap& map, ThreadPool& pool)
      : ReducedSolver(structure.pattern, map), pool_(pool), cholesky_(map.num_columns) {}

  void start(const std::vector<double>& diagonal) override {
    cholesky_.set_zero(pool_);
    for (int k = 0; k < cholesky_.size(); ++k) cholesky_.at(k, k) = diagonal[k];
  }
  bool factorize() override { return cholesky_.factorize(pool_); }
  void solve_columns(Eigen::MatrixXd& x) override { cholesky_.solve(x, pool_); }
  Eigen::MatrixXd inverse_product(const Eigen::SparseMatrix<double>& x, int) override {
    const auto same = [](int column) { return column; };
    return cholesky_.inverse_product(entries_of(x, same), static_cast<int>(x.cols()));
  }
  double log_determinant() const override { return cholesky_.log_determinant(); }

 private:
  std::span<double> values() override { return cholesky_.values(); }
  int position(int block) const override { return block; }
  BlockPlace place(int row_block, int column_block) const override {
    return {.first =
                map().block_begin[row_block] + cholesky_.stride() * map().block_begin[column_block],
            .stride = cholesky_.stride()};
  }
  void solve_in_place(std::vector<double>& x) override { cholesky_.solve(x); }

  ThreadPool& pool_;
  DenseCholesky cholesky_;
};

class SparseReducedSolver final : public ReducedSolver {
 public:
  SparseReducedSolver(const ReducedStructure& structure, const ParameterMap& map, ThreadPool& pool)
      : ReducedSolver(structure.pattern, map),
        pool_(pool),
        supernodes_(structure.supernodes),
        cholesky_(structure.supernodes),
        halves_(static_cast<std::size_t>(pool.num_threads())) {}

  void start(const std::vector<double>& diagonal) override {
    cholesky_.set_zero(pool_);
    for (int block = 0; block < map().num_blocks(); ++block) {
      const BlockPlace at = place(position(block), position(block));
      const int first = map().block_begin[block];
      for (int k = first; k < map().block_begin[block + 1]; ++k)
        values()[at.of(k - first, k - first)] = diagonal[k];
    }
  }
  bool factorize() override { return cholesky_.factorize(pool_); }
  double log_determinant() const override { return cholesky_.log_determinant(); }

  void solve_columns(Eigen::MatrixXd& x) override {
    Eigen::MatrixXd placed(x.rows(), x.cols());
    for (int k = 0; k < map().num_columns; ++k) placed.row(place_of(k)) = x.row(k);
    cholesky_.solve(placed, pool_);
    for (int k = 0; k < map().num_columns; ++k) x.row(k) = placed.row(place_of(k));
  }
  Eigen::MatrixXd inverse_product(const Eigen::SparseMatrix<double>& x, int worker) override {
    const auto place = [this](int column) { return place_of(column); };
    return cholesky_.inverse_product(
        entries_of(x, place), static_cast<int>(x.cols()), halves_[worker]);
  }

 private:
  std::span<double> values() override { return cholesky_.values(); }
  int position(int block) const override { return supernodes_.position[block]; }
  BlockPlace place(int row_block, int column_block) const override {
    return cholesky_.place(row_block, column_block);
  }

  void solve_in_place(std::vector<double>& x) override {
    placed_.resize(x.size());
    for (int k = 0; k < map().num_columns; ++k) placed_[place_of(k)] = x[k];
    cholesky_.solve(placed_, pool_);
    for (int k = 0; k < map().num_columns; ++k) x[k] = placed_[place_of(k)];
  }
  int place_of(int column) const {
    const int block = map().block_of[column];
    return supernodes_.first_column[position(block)] + column - map().block_begin[block];
  }

  ThreadPool& pool_;
  const Supernodes& supernodes_;
  SupernodalCholesky cholesky_;
  std::vector<double> placed_;                            // a right-hand side
  std::vector<SupernodalCholesky::HalfSolution> halves_;  // of each thread
};

// Calls f(row, column, value), both within their variable blocks, for the entries of a camera block
// in those segments: panel by panel, as they lie in memory.
template <class Segment, class F>
void for_each_entry(
    const Segment& rows, const Segment& columns, int size, const double* block, const F& f) {
  int first = 0;
  while (first < size) {
    const int width = panel_width(size - first);
    const double* panel = block + first * size;
    const int begin = std::max(first, rows.first);
    const int end = std::min(first + width, rows.first + rows.length);
    for (int c = 0; c < columns.length; ++c) {
      const double* values = panel + (columns.first + c) * width - first;
      for (int r = begin; r < end; ++r)
        f(rows.offset + r - rows.first, columns.offset + c, values[r]);
    }
    first += width;
  }
}

}  // namespace

ReducedSolver::ReducedSolver(const CameraPattern& pattern, const ParameterMap& map)
    : pattern_(pattern), map_(map) {
  const std::vector<char> shared = shared_columns(map);
  segment_begin_.push_back(0);
  for (int i = 0; i < pattern.num_rows(); ++i) add_segments(i, shared);
}

void ReducedSolver::add_segments(int camera, const std::vector<char>& shared) {
  const int* columns = map_.columns_of(camera);
  for (int k = 0; k < map_.camera_size; ++k) {
    const int column = columns[k];
    if (column == kNoColumn) continue;
    const int block = map_.block_of[column];
    const bool goes_on = segments_.size() > segment_begin_.back() &&
                         segments_.back().first + segments_.back().length == k &&
                         columns[k - 1] == column - 1 && segments_.back().block == block;
    if (goes_on) {
      ++segments_.back().length;
    } else {
      segments_.push_back({.first = k,
                           .length = 1,
                           .block = block,
                           .offset = column - map_.block_begin[block],
                           .shared = shared[column] != 0});
    }
  }
  segment_begin_.push_back(segments_.size());
}

void ReducedSolver::add_row(int i, const double* row_blocks, Columns columns) {
  const long area = static_cast<long>(map_.camera_size) * map_.camera_size;
  for (long block = pattern_.row_begin[i]; block < pattern_.row_begin[i + 1]; ++block) {
    const int j = pattern_.column[block];
    for (const Segment& a : segments_of(i)) {
      for (const Segment& b : segments_of(j)) {
        if ((a.shared || b.shared) != (columns == Columns::kShared)) continue;
        add_pair(a, b, i == j, row_blocks + area * (block - pattern_.row_begin[i]));
      }
    }
  }
}

// A block on the diagonal is symmetric: only its lower half counts.
void ReducedSolver::add_pair(const Segment& rows,
                             const Segment& columns,
                             bool diagonal,
                             const double* block) {
  if (rows.block == columns.block) return add_within(rows, columns, diagonal, block);
  if (diagonal && rows.block < columns.block) return;
  const int row_block = position(rows.block), column_block = position(columns.block);
  double* matrix = values().data();
  if (row_block > column_block) {
    const BlockPlace at = place(row_block, column_block);
    for_each_entry(rows, columns, map_.camera_size, block, [&](int r, int c, double value) {
      matrix[at.of(r, c)] += value;
    });
  } else {
    const BlockPlace at = place(column_block, row_block);
    for_each_entry(rows, columns, map_.camera_size, block, [&](int r, int c, double value) {
      matrix[at.of(c, r)] += value;
    });
  }
}

void ReducedSolver::add_within(const Segment& rows,
                               const Segment& columns,
                               bool diagonal,
                               const double* block) {
  const int position_of_both = position(rows.block);
  const BlockPlace at = place(position_of_both, position_of_both);
  double* matrix = values().data();
  for_each_entry(rows, columns, map_.camera_size, block, [&](int r, int c, double value) {
    if (diagonal && r < c) return;
    // A shared parameter meets itself: blocks (i, j) and (j, i) both add to the diagonal.
    const double share = r == c && !diagonal ? 2.0 * value : value;
    matrix[at.of(std::max(r, c), std::min(r, c))] += share;
  });
}

void ReducedSolver::sum_over(Exchange& ranks) {
  if (ranks.num_ranks() == 1) return;
  if (couples_.empty()) couples_ = find_couples();
  std::vector<double> passed;
  for (auto begin = couples_.begin(); begin != couples_.end();) {
    passed.clear();
    auto end = begin;
    while (end != couples_.end() && passed.size() < kNumbersAtATime)
      for_each_value(*end++, [&](double value) { passed.push_back(value); });
    ranks.sum(passed);
    auto next = passed.begin();
    while (begin != end) for_each_value(*begin++, [&](double& value) { value = *next++; });
  }
}

std::vector<ReducedSolver::Couple> ReducedSolver::find_couples() const {
  std::vector<Couple> couples;
  for (int i = 0; i < pattern_.num_rows(); ++i) {
    for (int j : pattern_.columns_of_row(i)) {
      for (const Segment& a : segments_of(i)) {
        for (const Segment& b : segments_of(j)) {
          const bool a_is_later = position(a.block) >= position(b.block);
          couples.push_back(a_is_later ? Couple{a.block, b.block} : Couple{b.block, a.block});
        }
      }
    }
  }
  std::ranges::sort(couples);
  couples.erase(std::unique(couples.begin(), couples.end()), couples.end());
  couples.shrink_to_fit();
  return couples;
}

template <class F>
void ReducedSolver::for_each_value(Couple couple, const F& f) {
  const auto size = [this](int b) { return map_.block_begin[b + 1] - map_.block_begin[b]; };
  const BlockPlace at = place(position(couple.row), position(couple.column));
  double* matrix = values().data();
  for (int c = 0; c < size(couple.column); ++c) {
    for (int r = couple.row == couple.column ? c : 0; r < size(couple.row); ++r)
      f(matrix[at.of(r, c)]);
  }
}

bool ReducedSolver::solve(std::vector<double>& x) {
  solve_in_place(x);
  return std::all_of(x.begin(), x.end(), [](double value) { return std::isfinite(value); });
}

std::unique_ptr<ReducedSolver> make_dense_reduced_solver(const ReducedStructure& structure,
                                                         const ParameterMap& map,
                                                         ThreadPool& pool) {
  return std::make_unique<DenseReducedSolver>(structure, map, pool);
}

std::unique_ptr<ReducedSolver> make_sparse_reduced_solver(const ReducedStructure& structure,
                                                          const ParameterMap& map,
                                                          ThreadPool& pool) {
  return std::make_unique<SparseReducedSolver>(structure, map, pool);
}

}  // namespace sfmcpp::linear

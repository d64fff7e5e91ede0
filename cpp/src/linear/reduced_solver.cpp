#include "reduced_solver.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

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

bool is_finite(const std::vector<double>& x) {
  return std::ranges::all_of(x, [](double value) { return std::isfinite(value); });
}

class DenseReducedSolver final : public ReducedSolver {
 public:
  DenseReducedSolver(const ReducedStructure& structure,
                     std::unique_ptr<const PosesFirst> order,
                     ThreadPool& pool)
      : ReducedSolver(structure.pattern, order->map),
        pool_(pool),
        order_(std::move(order)),
        cholesky_(map().num_columns) {}

  void start(const std::vector<double>& diagonal) override {
    diagonal_.resize(diagonal.size());
    for (int k = 0; k < cholesky_.size(); ++k) diagonal_[place(k)] = diagonal[k];
    if (!map().has_shared_columns) return;
    cholesky_.set_zero(pool_);
    for (int k = 0; k < cholesky_.size(); ++k) cholesky_.at(k, k) = diagonal_[k];
  }
  bool factorize() override { return cholesky_.factorize(pool_); }
  void solve_columns(Eigen::MatrixXd& x) override {
    Eigen::MatrixXd placed(x.rows(), x.cols());
    for (int k = 0; k < cholesky_.size(); ++k) placed.row(place(k)) = x.row(k);
    cholesky_.solve(placed, pool_);
    for (int k = 0; k < cholesky_.size(); ++k) x.row(k) = placed.row(place(k));
  }
  Eigen::MatrixXd inverse_product(const Eigen::SparseMatrix<double>& x, int) override {
    const auto place_of = [this](int column) { return place(column); };
    return cholesky_.inverse_product(entries_of(x, place_of), static_cast<int>(x.cols()));
  }
  bool has_poses_first() const override { return true; }
  bool solve_poses(std::vector<double>& x) override {
    solve_leading(order_->num_poses, x);
    return is_finite(x);
  }
  double log_determinant() const override { return cholesky_.log_determinant(); }

 private:
  // Every pair of cameras has a place of its own, which is written once.
  const double* diagonal_to_set() const override {
    return map().has_shared_columns ? nullptr : diagonal_.data();
  }
  std::span<double> values() override { return cholesky_.values(); }
  int position(int block) const override { return block; }
  BlockPlace place(int row_block, int column_block) const override {
    return {.first = std::int64_t{kStrip} * map().block_begin[column_block],
            .stride = kStrip,
            .rows = cholesky_.row_places().data() + map().block_begin[row_block]};
  }
  void solve_in_place(std::vector<double>& x) override { solve_leading(cholesky_.size(), x); }

  // The others are zero.
  void solve_leading(int columns, std::vector<double>& x) {
    placed_.resize(cholesky_.padded_size());
    for (int k = 0; k < cholesky_.size(); ++k) placed_[place(k)] = x[k];
    cholesky_.solve(placed_, columns);
    std::fill(placed_.begin() + columns, placed_.end(), 0.0);
    for (int k = 0; k < cholesky_.size(); ++k) x[k] = placed_[place(k)];
  }
  int place(int column) const { return order_->place[column]; }

  ThreadPool& pool_;
  std::unique_ptr<const PosesFirst> order_;
  DenseCholesky cholesky_;
  std::vector<double> diagonal_;  // in the order of the matrix
  std::vector<double> placed_;    // a right-hand side, likewise
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

// The same column by column, with the rows unrolled: the compiler knows where they lie.
template <int kSize, int kFirst, class Segment, class F, int... kRow>
void for_each_entry(std::integer_sequence<int, kRow...>,
                    const Segment& rows,
                    const Segment& columns,
                    const double* block,
                    const F& f) {
  constexpr int kPlace[] = {panel_index(kSize, kFirst + kRow, 0)...};
  constexpr int kStride[] = {panel_index(kSize, kFirst + kRow, 1) - kPlace[kRow]...};
  for (int c = 0; c < columns.length; ++c) {
    const int column = columns.first + c;
    (f(rows.offset + kRow, columns.offset + c, block[kPlace[kRow] + kStride[kRow] * column]), ...);
  }
}

template <int kSize, int kFirst, int kLength, class Segment, class F>
bool unrolled(
    const Segment& rows, const Segment& columns, int size, const double* block, const F& f) {
  if (size != kSize || rows.first != kFirst || rows.length != kLength) return false;
  for_each_entry<kSize, kFirst>(
      std::make_integer_sequence<int, kLength>{}, rows, columns, block, f);
  return true;
}

// The common ones: of a pose with three intrinsics apart and as one, and of a pose alone.
template <class Segment, class F>
void for_each_entry_fast(
    const Segment& rows, const Segment& columns, int size, const double* block, const F& f) {
  if (!unrolled<9, 0, 6>(rows, columns, size, block, f) &&
      !unrolled<9, 6, 3>(rows, columns, size, block, f) &&
      !unrolled<9, 0, 9>(rows, columns, size, block, f) &&
      !unrolled<6, 0, 6>(rows, columns, size, block, f))
    for_each_entry(rows, columns, size, block, f);
}

}  // namespace

ReducedSolver::ReducedSolver(const CameraPattern& pattern, const ParameterMap& map)
    : pattern_(pattern), map_(map) {
  const std::vector<char> shared = shared_columns(map);
  const auto cameras = static_cast<std::size_t>(pattern.num_rows());
  segments_.reserve(2 * cameras);  // pose and intrinsics; more where rigs have sensors
  segment_begin_.reserve(cameras + 1);
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

// For a camera block in the places of two segments: what is there and what is added.
struct ReducedSolver::Adds {
  void operator()(double& entry, double value) const { entry += value; }
};
struct ReducedSolver::Sets {
  void operator()(double& entry, double value) const { entry = value; }
};

void ReducedSolver::add_row(int i, const double* row_blocks, Columns columns) {
  if (const double* diagonal = diagonal_to_set()) return set_row(i, row_blocks, diagonal);
  const long area = static_cast<long>(map_.camera_size) * map_.camera_size;
  for (long block = pattern_.row_begin[i]; block < pattern_.row_begin[i + 1]; ++block) {
    const int j = pattern_.column[block];
    for (const Segment& a : segments_of(i)) {
      for (const Segment& b : segments_of(j)) {
        if ((a.shared || b.shared) != (columns == Columns::kShared)) continue;
        put_pair(a, b, i == j, row_blocks + area * (block - pattern_.row_begin[i]), Adds());
      }
    }
  }
}

// What is not in the pattern is zero, too.
void ReducedSolver::set_row(int i, const double* row_blocks, const double* diagonal) {
  static constexpr double kZeros[kMaxCameraSize * kMaxCameraSize] = {};
  const long area = static_cast<long>(map_.camera_size) * map_.camera_size;
  const std::span<const int> met = pattern_.columns_of_row(i);
  std::size_t next = 0;
  for (int j = i; j < pattern_.num_rows(); ++j) {
    const bool is_met = next < met.size() && met[next] == j;
    const double* block = is_met ? row_blocks + area * static_cast<long>(next) : kZeros;
    next += is_met;
    for (const Segment& a : segments_of(i)) {
      for (const Segment& b : segments_of(j)) put_pair(a, b, i == j, block, Sets());
    }
  }
  for (const Segment& of : segments_of(i)) {
    const BlockPlace at = place(position(of.block), position(of.block));
    for (int k = of.offset; k < of.offset + of.length; ++k)
      values()[at.of(k, k)] += diagonal[map_.block_begin[of.block] + k];
  }
}

// A block on the diagonal is symmetric: only its lower half counts.
template <class Put>
void ReducedSolver::put_pair(const Segment& rows,
                             const Segment& columns,
                             bool diagonal,
                             const double* block,
                             const Put& put) {
  if (rows.block == columns.block) return put_within(rows, columns, diagonal, block, put);
  if (diagonal && rows.block < columns.block) return;
  const int row_block = position(rows.block), column_block = position(columns.block);
  double* matrix = values().data();
  if (row_block > column_block) {
    const BlockPlace at = place(row_block, column_block);
    for_each_entry_fast(rows, columns, map_.camera_size, block, [&](int r, int c, double value) {
      put(matrix[at.of(r, c)], value);
    });
  } else {
    const BlockPlace at = place(column_block, row_block);
    for_each_entry_fast(rows, columns, map_.camera_size, block, [&](int r, int c, double value) {
      put(matrix[at.of(c, r)], value);
    });
  }
}

template <class Put>
void ReducedSolver::put_within(const Segment& rows,
                               const Segment& columns,
                               bool diagonal,
                               const double* block,
                               const Put& put) {
  const int position_of_both = position(rows.block);
  const BlockPlace at = place(position_of_both, position_of_both);
  double* matrix = values().data();
  for_each_entry(rows, columns, map_.camera_size, block, [&](int r, int c, double value) {
    if (diagonal && r < c) return;
    // A shared parameter meets itself: blocks (i, j) and (j, i) both add to the diagonal.
    const double share = r == c && !diagonal ? 2.0 * value : value;
    put(matrix[at.of(std::max(r, c), std::min(r, c))], share);
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
  return is_finite(x);
}

std::unique_ptr<ReducedSolver> make_dense_reduced_solver(const ReducedStructure& structure,
                                                         const ParameterMap& map,
                                                         ThreadPool& pool) {
  return std::make_unique<DenseReducedSolver>(
      structure, std::make_unique<const PosesFirst>(poses_first(map)), pool);
}

std::unique_ptr<ReducedSolver> make_sparse_reduced_solver(const ReducedStructure& structure,
                                                          const ParameterMap& map,
                                                          ThreadPool& pool) {
  return std::make_unique<SparseReducedSolver>(structure, map, pool);
}

}  // namespace sfmcpp::linear

#include "sfmcpp/linear/dense_cholesky.hpp"

#include <algorithm>
#include <cmath>

#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/linear/cholesky_kernels.hpp"

namespace sfmcpp::linear {
namespace {

constexpr int kMostStripsOfGroup = 4;
constexpr int kGroupsPerThread = 2;  // at least, for threads to wait little for one another
constexpr int kInnerStrips = 16;     // of two factors, which the nearest cache holds
constexpr int kColumnsPerTask = 32;  // right-hand sides that one task solves for

// Ends the work of all threads.
struct NotPositiveDefinite {};

// By groups of strips, in order: threads take them one after the other. A group passes through the
// columns from the left and waits, at each strip of columns, for the strip of rows that has their
// square: one thread is a little behind another. Nobody waits for a thread that has not come: a
// group that is waited for has been taken. Every entry is the sum over its columns in their order,
// so the bits do not depend on groups or threads.
//
// Regions for the steps of a panel took as long with two threads as with one below 500 rows: what
// one had computed the other needed at once.
class Factorization {
 public:
  Factorization(const CholeskyKernels& kernels,
                double* matrix,
                std::span<StripProgress> strips,
                ThreadPool& pool)
      : kernels_(kernels),
        matrix_(matrix),
        strips_(strips),
        pool_(pool),
        group_(
            std::clamp(count() / (kGroupsPerThread * pool.num_threads()), 1, kMostStripsOfGroup)) {
    for (StripProgress& strip : strips_) {
      strip.solved.store(0, std::memory_order_relaxed);
      strip.squared = 0;
    }
  }

  bool run() {
    try {
      pool_.parallel_for_worker(pool_.num_threads(), [this](int, int worker) { work(worker); });
    } catch (const NotPositiveDefinite&) {
      return false;
    }
    return true;
  }

 private:
  int count() const { return static_cast<int>(strips_.size()); }
  // Row `strip` of the strips of columns from `column` on.
  double* at(int strip, int column) const { return matrix_ + strip_begin(strip, column); }

  void work(int worker) {
    try {
      for (int begin; (begin = next_.fetch_add(group_)) < count();) {
        factor_group(begin, std::min(begin + group_, count()));
        pool_.heed_stop(worker);
      }
    } catch (...) {
      stopped_ = true;  // nobody waits for what does not come
      throw;
    }
  }

  void factor_group(int begin, int end) {
    for (int column = 0; column < begin; ++column) {
      subtract_products(begin, end, column);
      if (solved(column) <= column) subtract_squares(begin, end, column);  // instead of waiting
      wait_for(column, column + 1);
      solve(begin, end, column);
    }
    for (int column = begin; column < end; ++column) {
      subtract_squares(column, column + 1, column);
      if (!kernels_.factor(at(column, column), kStrip, kStrip)) throw NotPositiveDefinite{};
      set_solved(column, column + 1);
      subtract_products(column + 1, end, column);
      solve(column + 1, end, column);
    }
  }

  // From what these strips have in a strip of columns, their products with its row, as it comes.
  void subtract_products(int begin, int end, int column) {
    for (int inner = 0, next; inner < column; inner = next) {
      next = std::min({wait_for(column, inner + 1), column, inner + kInnerStrips});
      for (int strip = begin; strip < end; ++strip)
        subtract(at(strip, inner), at(column, inner), at(strip, column), next - inner);
    }
  }

  // From the squares on the diagonal, those of the columns before `column`.
  void subtract_squares(int begin, int end, int column) {
    for (int strip = begin; strip < end; ++strip) {
      int& inner = strips_[strip].squared;
      if (inner < column)
        subtract(at(strip, inner), at(strip, inner), at(strip, strip), column - inner);
      inner = column;
    }
  }

  void subtract(const double* a, const double* b, double* c, int inner) const {
    kernels_.update_packed(a, b, c, kStrip, kStrip * inner, kStrip);
  }

  void solve(int begin, int end, int column) {
    for (int strip = begin; strip < end; ++strip) {
      kernels_.solve_strip(at(column, column), at(strip, column), kStrip, kStrip);
      set_solved(strip, column + 1);
    }
  }

  int solved(int strip) const { return strips_[strip].solved.load(std::memory_order_acquire); }
  void set_solved(int strip, int columns) {
    strips_[strip].solved.store(columns, std::memory_order_release);
  }
  // How many there are, once there are so many.
  int wait_for(int strip, int columns) const {
    SpinWait wait;
    while (solved(strip) < columns) {
      if (stopped_) throw NotPositiveDefinite{};  // or another failure, which came first
      wait.once();
    }
    return solved(strip);
  }

  const CholeskyKernels& kernels_;
  double* matrix_;
  std::span<StripProgress> strips_;
  ThreadPool& pool_;
  int group_;  // strips
  std::atomic<int> next_{0};
  std::atomic<bool> stopped_{false};
};

// Columns in whole strips, filled up with zeros.
class PaddedColumns {
 public:
  PaddedColumns(int rows, int columns)
      : values_(Eigen::MatrixXd::Zero(round_up(rows, kStrip), columns)) {}

  template <class F>
  void for_each(const F& f) {
    for (Eigen::Index c = 0; c < values_.cols(); ++c) f(values_.col(c).data());
  }
  Eigen::MatrixXd& values() { return values_; }

 private:
  Eigen::MatrixXd values_;
};

}  // namespace

CholeskyKernels cholesky_kernels() { return SFMCPP_FOR_ACTIVE_ISA(cholesky_kernels_of()); }

DenseCholesky::DenseCholesky(int size, const CholeskyKernels& kernels)
    : kernels_(kernels), size_(size), progress_(ThreadPool::num_parts(size, kStrip)) {
  for (int row = 0; row < padded_size(); ++row)
    row_places_.push_back(strip_begin(row / kStrip) + row % kStrip);
  matrix_.resize(static_cast<std::size_t>(strip_begin(num_strips())));
  set_padding();
}

void DenseCholesky::set_zero(ThreadPool& pool) {
  pool.parallel_for(num_strips(), [this](int strip) {
    std::fill(matrix_.data() + strip_begin(strip), matrix_.data() + strip_begin(strip + 1), 0.0);
  });
  set_padding();
}

// Rows of the identity, and so are those of its factor.
void DenseCholesky::set_padding() {
  for (int row = size_; row < padded_size(); ++row) {
    for (int column = 0; column < row; ++column) at(row, column) = 0.0;
    at(row, row) = 1.0;
  }
}

bool DenseCholesky::factorize(ThreadPool& pool) {
  const bool is_positive = Factorization(kernels_, matrix_.data(), progress_, pool).run();
  if (!is_positive) set_padding();  // may be no numbers any more
  return is_positive;
}

void DenseCholesky::solve(std::span<double> x, int rows) const {
  const int strips = ThreadPool::num_parts(rows, kStrip);
  for (int strip = 0; strip < strips; ++strip)
    kernels_.forward_strip(matrix_.data(), 0, strip, x.data());
  std::fill(x.begin() + rows, x.begin() + std::ptrdiff_t{kStrip} * strips, 0.0);
  for (int strip = strips - 1; strip >= 0; --strip)
    kernels_.backward_strip(matrix_.data(), strip, strips, x.data());
}

void DenseCholesky::solve(Eigen::MatrixXd& x, ThreadPool& pool) const {
  const auto columns = static_cast<int>(x.cols());
  pool.parallel_for(ThreadPool::num_parts(columns, kColumnsPerTask), [&](int task) {
    const int begin = task * kColumnsPerTask;
    auto slab = x.middleCols(begin, std::min(kColumnsPerTask, columns - begin));
    PaddedColumns padded(size_, static_cast<int>(slab.cols()));
    padded.values().topRows(size_) = slab;
    for (int strip = 0; strip < num_strips(); ++strip)
      padded.for_each([&](double* y) { kernels_.forward_strip(matrix_.data(), 0, strip, y); });
    for (int strip = num_strips() - 1; strip >= 0; --strip)
      padded.for_each(
          [&](double* y) { kernels_.backward_strip(matrix_.data(), strip, num_strips(), y); });
    slab = padded.values().topRows(size_);
  });
}

Eigen::MatrixXd DenseCholesky::inverse_product(const SparseEntries& x, int columns) const {
  int first = size_;
  for (const auto& entry : x) first = std::min(first, entry.row());
  PaddedColumns padded(size_, columns);
  for (const auto& entry : x) padded.values()(entry.row(), entry.col()) = entry.value();
  for (int strip = first / kStrip; strip < num_strips(); ++strip) {
    padded.for_each(
        [&](double* y) { kernels_.forward_strip(matrix_.data(), first / kStrip, strip, y); });
  }
  const auto below = padded.values().bottomRows(padded_size() - first);
  return below.transpose() * below;
}

double DenseCholesky::log_determinant() const {
  double sum = 0.0;
  for (int k = 0; k < size_; ++k) sum += std::log(at(k, k));
  return 2.0 * sum;
}

}  // namespace sfmcpp::linear

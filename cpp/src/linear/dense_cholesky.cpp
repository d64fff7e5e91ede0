#include "sfmcpp/linear/dense_cholesky.hpp"

#include <algorithm>
#include <cmath>

#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/linear/cholesky_isa.hpp"

namespace sfmcpp::linear {
namespace {

// From this size on, tiles of columns are wider, and tasks are several strips that share a block of
// b.
constexpr int kLarge = 1024;
constexpr int kColumnsPerTask = 32;  // right-hand sides that one task solves for
constexpr int kInnerBlock = 256;     // columns of b that stay in the cache

int round_up(int n, int multiple) { return (n + multiple - 1) / multiple * multiple; }

// One factorisation under way.
class Factorization {
 public:
  Factorization(const CholeskyKernels& kernels, double* matrix, long ld, int size, ThreadPool& pool)
      : kernels_(kernels),
        matrix_(matrix),
        ld_(ld),
        size_(size),
        tile_(size < kLarge ? 32 : 64),
        rows_per_task_(size < kLarge ? kStrip : 4 * kStrip),
        pool_(pool) {}

  bool run() {
    for (int column = 0; column < size_; column += tile_) {
      const int width = std::min(tile_, size_ - column);
      for_each_task(column, [&](int begin, int end) { update(begin, end, column, width); });
      if (!kernels_.factor(at(column, column), ld_, width)) return false;
      for_each_task(column + width, [&](int begin, int end) { solve(begin, end, column, width); });
    }
    return true;
  }

 private:
  double* at(int row, int column) const { return matrix_ + column * ld_ + row; }

  // f(begin, end) for the rows from `first` on, in parallel.
  template <class F>
  void for_each_task(int first, const F& f) {
    pool_.parallel_for((size_ - first + rows_per_task_ - 1) / rows_per_task_, [&](int task) {
      const int begin = first + task * rows_per_task_;
      f(begin, std::min(begin + rows_per_task_, size_));
    });
  }

  void update(int begin, int end, int column, int width) const {
    for (int inner = 0; inner < column; inner += kInnerBlock) {
      const int count = std::min(kInnerBlock, column - inner);
      for (int row = begin; row < end; row += kStrip) {
        kernels_.update(at(row, inner), at(column, inner), at(row, column), ld_, count, width);
      }
    }
  }

  void solve(int begin, int end, int column, int width) const {
    for (int row = begin; row < end; row += kStrip) {
      kernels_.solve_strip(at(column, column), at(row, column), ld_, width);
    }
  }

  const CholeskyKernels& kernels_;
  double* matrix_;
  long ld_;
  int size_;
  int tile_;  // columns factored at a time
  int rows_per_task_;
  ThreadPool& pool_;
};

}  // namespace

CholeskyKernels cholesky_kernels() { return SFMCPP_FOR_ACTIVE_ISA(cholesky_kernels_of()); }

DenseCholesky::DenseCholesky(int size, const CholeskyKernels& kernels)
    : kernels_(kernels),
      padded_size_(round_up(size, kStrip)),
      size_(size),
      ld_(padded_size_ + kPanel),
      matrix_(static_cast<std::size_t>(padded_size_) * ld_) {}

void DenseCholesky::set_zero(ThreadPool& pool) {
  pool.parallel_for(padded_size_ / kStrip, [this](int task) {
    for (int c = task * kStrip; c < (task + 1) * kStrip; ++c) {
      // From the strip of the diagonal on: the kernels read whole strips.
      std::fill(&at(task * kStrip, c), &at(task * kStrip, c) + (padded_size_ - task * kStrip), 0.0);
      if (c >= size_) at(c, c) = 1.0;
    }
  });
}

bool DenseCholesky::factorize(ThreadPool& pool) {
  return Factorization(kernels_, matrix_.data(), ld_, padded_size_, pool).run();
}

void DenseCholesky::solve(std::span<double> x) {
  kernels_.forward(matrix_.data(), ld_, size_, x.data());
  kernels_.backward(matrix_.data(), ld_, size_, x.data());
}

void DenseCholesky::solve(Eigen::MatrixXd& x, ThreadPool& pool) const {
  const Eigen::Map<const Eigen::MatrixXd, 0, Eigen::OuterStride<>> l(
      matrix_.data(), size_, size_, Eigen::OuterStride<>(ld_));
  const auto columns = static_cast<int>(x.cols());
  pool.parallel_for((columns + kColumnsPerTask - 1) / kColumnsPerTask, [&](int task) {
    const int begin = task * kColumnsPerTask;
    auto slab = x.middleCols(begin, std::min(kColumnsPerTask, columns - begin));
    l.triangularView<Eigen::Lower>().solveInPlace(slab);
    l.transpose().triangularView<Eigen::Upper>().solveInPlace(slab);
  });
}

double DenseCholesky::log_determinant() const {
  double sum = 0.0;
  for (long k = 0; k < size_; ++k) sum += std::log(matrix_[k * ld_ + k]);
  return 2.0 * sum;
}

}  // namespace sfmcpp::linear

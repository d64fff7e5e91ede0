#include "sfmcpp/linear/dense_cholesky.hpp"

#include <algorithm>
#include <cmath>

#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/linear/cholesky_isa.hpp"

namespace sfmcpp::linear {
namespace {

constexpr int kColumnsPerTask = 32;  // right-hand sides that one task solves for

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
  scratch_.resize(pool.num_threads());
  return factor_panel(
      kernels_, matrix_.data(), ld_, padded_size_, padded_size_, &pool, scratch_.data());
}

void DenseCholesky::solve(std::span<double> x) {
  kernels_.forward(matrix_.data(), ld_, size_, size_, x.data());
  kernels_.backward(matrix_.data(), ld_, size_, size_, x.data());
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

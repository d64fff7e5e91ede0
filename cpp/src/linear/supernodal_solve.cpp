// Triangular solves with the factor of supernodal_cholesky.hpp.
#include <algorithm>
#include <cmath>

#include "sfmcpp/linear/supernodal_cholesky.hpp"

namespace sfmcpp::linear {

// x ← L⁻¹ x for the columns of one supernode; its rows below are told.
void SupernodalCholesky::forward(int s, double* x, Outside* outside, std::vector<double>& y) const {
  const SupernodePanel& shape = s_.panel[s];
  double* own = x + s_.columns_begin(s);
  y.assign(static_cast<std::size_t>(shape.rows), 0.0);
  std::copy_n(own, shape.columns, y.begin());
  kernels_.forward(panel(s), shape.stride, shape.columns, static_cast<int>(shape.rows), y.data());
  std::copy_n(y.begin(), shape.columns, own);
  const std::span<const int> rows = s_.rows_of(s), offsets = s_.offsets_of(s);
  std::size_t above = 0;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const int first = s_.first_column[rows[k]], size = s_.first_column[rows[k] + 1] - first;
    double* to = x + first;
    if (outside != nullptr && s_.of_place[rows[k]] > outside->part->last) {
      while (outside->part->rows[above] < rows[k]) ++above;
      to = outside->taken.data() + outside->part->row_offset[above];
    }
    const double* from = y.data() + shape.top + offsets[k];
    for (int r = 0; r < size; ++r) to[r] += from[r];
  }
}

// x ← L⁻ᵀ x for the columns of one supernode, given its rows below.
void SupernodalCholesky::backward(int s, double* x, std::vector<double>& y) const {
  const SupernodePanel& shape = s_.panel[s];
  double* own = x + s_.columns_begin(s);
  y.assign(static_cast<std::size_t>(shape.rows), 0.0);
  std::copy_n(own, shape.columns, y.begin());
  const std::span<const int> rows = s_.rows_of(s), offsets = s_.offsets_of(s);
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const int first = s_.first_column[rows[k]], size = s_.first_column[rows[k] + 1] - first;
    std::copy_n(x + first, size, y.begin() + shape.top + offsets[k]);
  }
  kernels_.backward(panel(s), shape.stride, shape.columns, static_cast<int>(shape.rows), y.data());
  std::copy_n(y.begin(), shape.columns, own);
}

void SupernodalCholesky::solve(std::span<double> x, ThreadPool& pool) const {
  std::vector<std::vector<double>> buffer(pool.num_threads());
  std::vector<Outside> outside;
  for (const Subtrees& part : s_.subtrees)
    outside.push_back({&part, std::vector<double>(static_cast<std::size_t>(part.height))});
  const int parts = static_cast<int>(outside.size());
  pool.parallel_for_worker(parts, [&](int part, int worker) {
    const Subtrees& subtrees = *outside[part].part;
    for (int s = subtrees.first; s <= subtrees.last; ++s)
      forward(s, x.data(), &outside[part], buffer[worker]);
  });
  for (const Outside& taken : outside) {
    for (std::size_t k = 0; k < taken.part->rows.size(); ++k) {
      const int place = taken.part->rows[k], first = s_.first_column[place];
      for (int c = first; c < s_.first_column[place + 1]; ++c)
        x[c] += taken.taken[taken.part->row_offset[k] + c - first];
    }
  }
  for (int s : s_.top) forward(s, x.data(), nullptr, buffer[0]);
  for (auto s = s_.top.rbegin(); s != s_.top.rend(); ++s) backward(*s, x.data(), buffer[0]);
  pool.parallel_for_worker(parts, [&](int part, int worker) {
    const Subtrees& subtrees = *outside[part].part;
    for (int s = subtrees.last; s >= subtrees.first; --s) backward(s, x.data(), buffer[worker]);
  });
}

void SupernodalCholesky::solve(Eigen::MatrixXd& x, ThreadPool& pool) const {
  pool.parallel_for(static_cast<int>(x.cols()), [&](int column) {
    std::vector<double> buffer;
    double* values = x.col(column).data();
    for (int s = 0; s < s_.count(); ++s) forward(s, values, nullptr, buffer);
    for (int s = s_.count() - 1; s >= 0; --s) backward(s, values, buffer);
  });
}

double SupernodalCholesky::log_determinant() const {
  double sum = 0.0;
  for (int s = 0; s < s_.count(); ++s) {
    for (int c = 0; c < s_.panel[s].columns; ++c)
      sum += std::log(panel(s)[c * (s_.panel[s].stride + 1)]);
  }
  return 2.0 * sum;
}

}  // namespace sfmcpp::linear

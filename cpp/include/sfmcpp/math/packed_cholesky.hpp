// Cholesky factorisation M = L Lᵀ of a small matrix whose size is known when compiling: lower
// triangles row by row, in N (N + 1) / 2 numbers, the diagonal of L stored inverted. For matrices
// that are factorised thousands of times each.
#pragma once

#include <array>
#include <cmath>

namespace sfmcpp {

template <int N>
class PackedCholesky {
 public:
  static constexpr int kEntries = N * (N + 1) / 2;
  using Vector = std::array<double, N>;
  using Lower = std::array<double, kEntries>;

  explicit PackedCholesky(const Lower& matrix) : factor_(matrix) {
    for (int row = 0; row < N; ++row) {
      for (int column = 0; column < row; ++column) {
        double sum = at(row, column);
        for (int k = 0; k < column; ++k) sum -= at(row, k) * at(column, k);
        at(row, column) = sum * at(column, column);
      }
      double pivot = at(row, row);
      for (int k = 0; k < row; ++k) pivot -= at(row, k) * at(row, k);
      positive_ = positive_ && pivot > 0.0;
      at(row, row) = 1.0 / std::sqrt(pivot);
    }
  }

  // Whether the matrix was positive definite; nothing else may be asked if it was not.
  bool positive() const { return positive_; }

  // M⁻¹ b.
  Vector solve(Vector b) const {
    for (int row = 0; row < N; ++row) {
      for (int k = 0; k < row; ++k) b[row] -= at(row, k) * b[k];
      b[row] *= at(row, row);
    }
    for (int row = N - 1; row >= 0; --row) {
      for (int k = row + 1; k < N; ++k) b[row] -= at(k, row) * b[k];
      b[row] *= at(row, row);
    }
    return b;
  }

  // L⁻¹.
  Lower inverse_factor() const {
    Lower inverse{};
    for (int column = 0; column < N; ++column) {
      inverse[index(column, column)] = at(column, column);
      for (int row = column + 1; row < N; ++row) {
        double sum = 0.0;
        for (int k = column; k < row; ++k) sum -= at(row, k) * inverse[index(k, column)];
        inverse[index(row, column)] = sum * at(row, row);
      }
    }
    return inverse;
  }

 private:
  static constexpr int index(int row, int column) { return row * (row + 1) / 2 + column; }
  double& at(int row, int column) { return factor_[index(row, column)]; }
  double at(int row, int column) const { return factor_[index(row, column)]; }

  Lower factor_;
  bool positive_ = true;
};

}  // namespace sfmcpp

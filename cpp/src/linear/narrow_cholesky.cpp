#include "narrow_cholesky.hpp"

#include "narrow_cholesky_isa.hpp"
#include "sfmcpp/core/isa.hpp"

namespace sfmcpp::linear {
namespace {

// L(row, column), with ones on the diagonal of the padding.
double entry(const DenseCholesky& lower, int row, int column) {
  if (row >= lower.size()) return row == column ? 1.0 : 0.0;
  return row < column ? 0.0 : lower.at(row, column);
}

// Of the block on the diagonal from row `first` on; a column after the other, by substitution.
void invert(const DenseCholesky& lower, int first, double* inverse) {
  for (int c = 0; c < kNarrowRows; ++c) {
    double* column = inverse + kNarrowRows * c;
    for (int r = 0; r < kNarrowRows; ++r) {
      double rest = r == c ? 1.0 : 0.0;
      for (int k = c; k < r; ++k) rest -= entry(lower, first + r, first + k) * column[k];
      column[r] = r < c ? 0.0 : rest / entry(lower, first + r, first + r);
    }
  }
}

}  // namespace

void NarrowCholesky::set(const DenseCholesky& cholesky) {
  blocks_ = (cholesky.size() + kNarrowRows - 1) / kNarrowRows;
  const auto count = static_cast<std::size_t>(blocks_);
  below_.resize(count == 0 ? 0 : count * (count - 1) / 2 * kNarrowArea);
  inverses_.resize(count * kNarrowArea);
  float* below = below_.data();
  for (int row = 0; row < blocks_; ++row) {
    for (int column = 0; column < row; ++column) {
      for (int k = 0; k < kNarrowArea; ++k) {
        *below++ = static_cast<float>(entry(
            cholesky, kNarrowRows * row + k % kNarrowRows, kNarrowRows * column + k / kNarrowRows));
      }
    }
    invert(cholesky, kNarrowRows * row, inverses_.data() + kNarrowArea * row);
  }
}

int NarrowCholesky::padded_size() const { return kNarrowRows * blocks_; }

void NarrowCholesky::solve(double* x) const {
  const NarrowFactor factor{
      .blocks = blocks_, .below = below_.data(), .inverses = inverses_.data()};
  SFMCPP_FOR_ACTIVE_ISA(solve_narrow(factor, x));
}

}  // namespace sfmcpp::linear

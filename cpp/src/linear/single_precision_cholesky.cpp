#include "single_precision_cholesky.hpp"

#include "sfmcpp/core/isa.hpp"
#include "single_precision_cholesky_kernels.hpp"

namespace sfmcpp::linear {
namespace {

// L(row, column), with ones on the diagonal of the padding.
double entry(const DenseCholesky& lower, int row, int column) {
  if (row >= lower.size()) return row == column ? 1.0 : 0.0;
  return row < column ? 0.0 : lower.at(row, column);
}

// Of the block on the diagonal from row `first` on; a column after the other, by substitution.
void invert(const DenseCholesky& lower, int first, double* inverse) {
  for (int c = 0; c < kFactorBlockSize; ++c) {
    double* column = inverse + kFactorBlockSize * c;
    for (int r = 0; r < kFactorBlockSize; ++r) {
      double rest = r == c ? 1.0 : 0.0;
      for (int k = c; k < r; ++k) rest -= entry(lower, first + r, first + k) * column[k];
      column[r] = r < c ? 0.0 : rest / entry(lower, first + r, first + r);
    }
  }
}

}  // namespace

void SinglePrecisionCholesky::set(const DenseCholesky& cholesky) {
  blocks_ = (cholesky.size() + kFactorBlockSize - 1) / kFactorBlockSize;
  const auto count = static_cast<std::size_t>(blocks_);
  below_.resize(count == 0 ? 0 : count * (count - 1) / 2 * kFactorBlockArea);
  inverses_.resize(count * kFactorBlockArea);
  float* below = below_.data();
  for (int row = 0; row < blocks_; ++row) {
    for (int column = 0; column < row; ++column) {
      for (int k = 0; k < kFactorBlockArea; ++k) {
        *below++ = static_cast<float>(entry(cholesky,
                                            kFactorBlockSize * row + k % kFactorBlockSize,
                                            kFactorBlockSize * column + k / kFactorBlockSize));
      }
    }
    invert(cholesky, kFactorBlockSize * row, inverses_.data() + kFactorBlockArea * row);
  }
}

int SinglePrecisionCholesky::padded_size() const { return kFactorBlockSize * blocks_; }

void SinglePrecisionCholesky::solve(double* x) const {
  const SinglePrecisionFactor factor{
      .blocks = blocks_, .below = below_.data(), .inverses = inverses_.data()};
  SFMCPP_FOR_ACTIVE_ISA(solve_with_factor(factor, x));
}

}  // namespace sfmcpp::linear

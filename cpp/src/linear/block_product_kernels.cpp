// Compiled once per instruction set; see core/isa.hpp for what may be used here.
#include "sfmcpp/linear/block_product_kernels.hpp"

#include "register_blocks.hpp"

namespace sfmcpp::linear::SFMCPP_ISA {
namespace {

// What of the sums of a row of blocks stays in registers. Of each panel the products with every
// column, whose lanes are added at the end; a panel one row high is a plain row of the block.
template <int D, int kFirst = 0, int kWidth = panel_width(D - kFirst)>
struct RowSums {
  Pack<kWidth> lanes[D];
  RowSums<D, kFirst + kWidth> rest;
};
template <int D, int kFirst>
struct RowSums<D, kFirst, 1> {
  Row<D> row;
};
template <int D>
struct RowSums<D, D, 1> {};

template <int D, int kFirst, int kWidth>
inline void set_zero(RowSums<D, kFirst, kWidth>& sums) {
  if constexpr (kFirst < D) {
    if constexpr (kWidth == 1) {
      set_zero(sums.row);
    } else {
      for (int r = 0; r < D; ++r) sums.lanes[r] = Pack<kWidth>(0.0);
      set_zero(sums.rest);
    }
  }
}

template <int kWidth>
SFMCPP_INLINE void add_on_grid(Pack<kWidth> x, double middle, double* sum) {
  const Pack<kWidth> m(middle);
  store(sum, load<kWidth>(sum) + ((x + m) - m));
}

// Of one block B, whose transpose lies in panels: `to_row` += B x and `other` += Bᵀ of_row.
template <int D, int kFirst, int kWidth>
inline void multiply(const float* block,
                     const double* x,
                     const double* of_row,
                     RowSums<D, kFirst, kWidth>& to_row,
                     double middle,
                     double* other) {
  if constexpr (kFirst < D) {
    const float* panel = block + kFirst * D;
    if constexpr (kWidth == 1) {
      Row<D> values, factors;
      load_row(panel, values);
      load_row(of_row, factors);
      add_scaled(to_row.row, values, x[kFirst]);
      add_on_grid(Pack<1>(dot(values, factors)), middle, other + kFirst);
    } else {
      const Pack<kWidth> xs = load<kWidth>(x + kFirst);
      Pack<kWidth> sum(0.0);
#pragma GCC unroll 18
      for (int r = 0; r < D; ++r) {
        const Pack<kWidth> values = load<kWidth>(panel + r * kWidth);
        to_row.lanes[r] += values * xs;
        sum += values * of_row[r];
      }
      add_on_grid(sum, middle, other + kFirst);
      multiply(block, x, of_row, to_row.rest, middle, other);
    }
  }
}

template <int D, int kFirst, int kWidth>
inline void add_to(double* out, const RowSums<D, kFirst, kWidth>& sums) {
  if constexpr (kFirst < D) {
    if constexpr (kWidth == 1) {
      Row<D> row;
      load_row(out, row);
      add_scaled(row, sums.row, 1.0);
      store_row(out, row);
    } else {
      for (int r = 0; r < D; ++r) out[r] += sum_of_lanes(sums.lanes[r]);
      add_to(out, sums.rest);
    }
  }
}

// Blocks follow one another in memory, but processors fetch them too late: of 10,000 cameras,
// products take 0.7 of the time when asked for so many numbers ahead. The vectors lie anywhere.
constexpr int kNumbersAhead = 1296;

template <int D>
void add_row(int n,
             const float* blocks,
             const int* column,
             int i,
             int first,
             const double* x,
             double middle,
             double* out) {
  constexpr int kAhead = 4;
  double of_row[D];
  for (int r = 0; r < D; ++r) of_row[r] = x[static_cast<long>(D) * i + r];
  RowSums<D> sums;
  set_zero(sums);
  for (int k = 0; k < n; ++k) {
    if (k + kAhead < n) {
      const long ahead = column[k + kAhead];
      __builtin_prefetch(x + D * ahead);
      __builtin_prefetch(out + D * (ahead - first), 1);
    }
    const long j = column[k];
    const float* block = blocks + static_cast<long>(D) * D * k;
    prefetch_numbers<D * D>(block + kNumbersAhead);
    multiply(block, x + D * j, of_row, sums, middle, out + D * (j - first));
  }
  double of_blocks[D] = {};
  add_to(of_blocks, sums);
  double* own = out + static_cast<long>(D) * (i - first);
  for (int r = 0; r < D; ++r) add_on_grid(Pack<1>(of_blocks[r]), middle, own + r);
}

template <int D, int kFirst = 0>
inline void add_symmetric_panels(const double* block, const double* x, double* out) {
  if constexpr (kFirst < D) {
    constexpr int kWidth = panel_width(D - kFirst);
    const double* panel = block + kFirst * D;
    Pack<kWidth> sum = load<kWidth>(out + kFirst);
    for (int c = 0; c < D; ++c) sum += load<kWidth>(panel + c * kWidth) * x[c];
    store(out + kFirst, sum);
    add_symmetric_panels<D, kFirst + kWidth>(block, x, out);
  }
}

template <int D>
void add_block(const double* block, const double* x, double* out) {
  add_symmetric_panels<D>(block, x, out);
}

// The part of the transpose that the panel of rows from kRow on has in that of columns from kColumn
// on: a square is transposed in registers, and where either is one wide both lie in one line.
template <int D, int kRow, int kColumn>
SFMCPP_INLINE void round_part(const double* block,
                              const double* rows,
                              const double* columns,
                              float* out) {
  constexpr int kHeight = panel_width(D - kRow), kWidth = panel_width(D - kColumn);
  const double* from = block + kRow * D + kColumn * kHeight;
  float* to = out + kColumn * D + kRow * kWidth;
  const auto scaled = [&](int c) {
    return load<kHeight>(from + c * kHeight) * load<kHeight>(rows + kRow) * columns[kColumn + c];
  };
  if constexpr (kWidth == 1) {
    store(to, scaled(0));
  } else if constexpr (kHeight == 1) {
    store(to, load<kWidth>(from) * load<kWidth>(columns + kColumn) * rows[kRow]);
  } else if constexpr (kHeight == kWidth) {
    Pack<kWidth> square[kWidth];
    for (int c = 0; c < kWidth; ++c) square[c] = scaled(c);
    transpose(square);
    for (int r = 0; r < kHeight; ++r) store(to + r * kWidth, square[r]);
  } else {
    for (int c = 0; c < kWidth; ++c) {
      const Pack<kHeight> column = scaled(c);
      for (int r = 0; r < kHeight; ++r) to[r * kWidth + c] = static_cast<float>(column[r]);
    }
  }
}

// Powers of two: their products are exact, in any order.
template <int D, int kRow = 0, int kColumn = 0>
inline void round_transposed(const double* block,
                             const double* rows,
                             const double* columns,
                             float* out) {
  if constexpr (kRow < D) {
    round_part<D, kRow, kColumn>(block, rows, columns, out);
    constexpr int kNext = kColumn + panel_width(D - kColumn);
    if constexpr (kNext < D) {
      round_transposed<D, kRow, kNext>(block, rows, columns, out);
    } else {
      round_transposed<D, kRow + panel_width(D - kRow), 0>(block, rows, columns, out);
    }
  }
}

template <int D>
BlockProductKernels kernels() {
  return {.add_row = &add_row<D>, .add_block = &add_block<D>, .round = &round_transposed<D>};
}

}  // namespace

BlockProductKernels product_kernels_for(int camera_size) {
  switch (camera_size) {
    case 6:
      return kernels<6>();
    case 9:
      return kernels<9>();
    case 12:
      return kernels<12>();
    default:
      return kernels<18>();
  }
}

}  // namespace sfmcpp::linear::SFMCPP_ISA

// Rows and D×D blocks held in vector registers, by the panels of block_layout.hpp. For
// *_kernels.cpp only: everything lies in the namespace of the instruction set and has internal
// linkage (core/isa.hpp).
#pragma once

#include "sfmcpp/core/simd.hpp"
#include "sfmcpp/linear/block_layout.hpp"

namespace sfmcpp::linear::SFMCPP_ISA {
namespace {

// A row of D numbers in vector registers of panel widths.
template <int D, int kFirst = 0>
struct Row {
  static constexpr int kWidth = panel_width(D - kFirst);
  Pack<kWidth> head;
  Row<D, kFirst + kWidth> tail;
};
template <int D>
struct Row<D, D> {};

template <int D, int kFirst = 0, class T>
inline void load_row(const T* p, Row<D, kFirst>& row) {
  if constexpr (kFirst < D) {
    row.head = load<Row<D, kFirst>::kWidth>(p + kFirst);
    load_row(p, row.tail);
  }
}

template <int D, int kFirst = 0, class T>
inline void store_row(T* p, const Row<D, kFirst>& row) {
  if constexpr (kFirst < D) {
    store(p + kFirst, row.head);
    store_row(p, row.tail);
  }
}

template <int D, int kFirst = 0>
inline void set_zero(Row<D, kFirst>& row) {
  if constexpr (kFirst < D) {
    row.head = Pack<Row<D, kFirst>::kWidth>(0.0);
    set_zero(row.tail);
  }
}

// row += x · s
template <int D, int kFirst = 0>
inline void add_scaled(Row<D, kFirst>& row, const Row<D, kFirst>& x, double s) {
  if constexpr (kFirst < D) {
    row.head += x.head * s;
    add_scaled(row.tail, x.tail, s);
  }
}

template <int D, int kFirst = 0>
inline void add_squares(Row<D, kFirst>& row, const Row<D, kFirst>& x) {
  if constexpr (kFirst < D) {
    row.head += x.head * x.head;
    add_squares(row.tail, x.tail);
  }
}

// A row of compensated sums.
template <int D, int kFirst = 0>
inline void add_compensated(Row<D, kFirst>& sum, Row<D, kFirst>& rest, const Row<D, kFirst>& x) {
  if constexpr (kFirst < D) {
    add_compensated(sum.head, rest.head, x.head);
    add_compensated(sum.tail, rest.tail, x.tail);
  }
}

template <int D, int kFirst = 0>
inline void add_compensated_scaled(Row<D, kFirst>& sum,
                                   Row<D, kFirst>& rest,
                                   const Row<D, kFirst>& x,
                                   double s) {
  Row<D, kFirst> scaled;
  set_zero(scaled);
  add_scaled(scaled, x, s);
  add_compensated(sum, rest, scaled);
}

// block += Σ_k a_kᵀ b_k: the rows of a lie in registers, the numbers of b (rank × D) are broadcast.
// A panel one row high is a plain row of the block: there b is what is loaded as vectors.
template <int D, int kRank, int kFirst = 0>
inline void rank_update(const Row<D, kFirst>* const (&a)[kRank], const double* b, double* block) {
  if constexpr (kFirst < D) {
    constexpr int kWidth = Row<D, kFirst>::kWidth;
    double* panel = block + kFirst * D;
    if constexpr (kWidth == 1) {
      Row<D> sum;
      load_row(panel, sum);
      for (int k = 0; k < kRank; ++k) {
        Row<D> row;
        load_row(b + k * D, row);
        add_scaled(sum, row, a[k]->head[0]);
      }
      store_row(panel, sum);
    } else {
      for (int c = 0; c < D; ++c) {
        Pack<kWidth> sum = load<kWidth>(panel + c * kWidth);
        for (int k = 0; k < kRank; ++k) sum += a[k]->head * b[k * D + c];
        store(panel + c * kWidth, sum);
      }
    }
    const Row<D, kFirst + kWidth>* rest[kRank];
    for (int k = 0; k < kRank; ++k) rest[k] = &a[k]->tail;
    rank_update<D, kRank>(rest, b, block);
  }
}

// A whole block in registers, for sums over many observations; the same panels.
template <int D, int kFirst = 0, int kWidth = panel_width(D - kFirst)>
struct Block {
  Pack<kWidth> columns[D];
  Block<D, kFirst + kWidth> rest;
};
template <int D, int kFirst>
struct Block<D, kFirst, 1> {
  Row<D> row;
};
template <int D>
struct Block<D, D, 1> {};

// block += aᵀ b with one row each; `b` in memory.
template <int D, int kFirst, int kWidth>
inline void add_outer(Block<D, kFirst, kWidth>& block, const Row<D, kFirst>& a, const double* b) {
  if constexpr (kFirst < D) {
    if constexpr (kWidth == 1) {
      Row<D> row;
      load_row(b, row);
      add_scaled(block.row, row, a.head[0]);
    } else {
#pragma GCC unroll 18
      for (int c = 0; c < D; ++c) block.columns[c] += a.head * b[c];
      add_outer(block.rest, a.tail, b);
    }
  }
}

template <int D, int kFirst, int kWidth>
inline void set_zero(Block<D, kFirst, kWidth>& block) {
  if constexpr (kFirst < D) {
    if constexpr (kWidth == 1) {
      set_zero(block.row);
    } else {
      for (int c = 0; c < D; ++c) block.columns[c] = Pack<kWidth>(0.0);
      set_zero(block.rest);
    }
  }
}

template <int D, int kFirst, int kWidth>
inline void load_block(const double* in, Block<D, kFirst, kWidth>& block) {
  if constexpr (kFirst < D) {
    if constexpr (kWidth == 1) {
      load_row(in + kFirst * D, block.row);
    } else {
      for (int c = 0; c < D; ++c) block.columns[c] = load<kWidth>(in + kFirst * D + c * kWidth);
      load_block(in, block.rest);
    }
  }
}

template <int D, int kFirst, int kWidth>
inline void store_block(const Block<D, kFirst, kWidth>& block, double* out) {
  if constexpr (kFirst < D) {
    if constexpr (kWidth == 1) {
      store_row(out + kFirst * D, block.row);
    } else {
      for (int c = 0; c < D; ++c) store(out + kFirst * D + c * kWidth, block.columns[c]);
      store_block(block.rest, out);
    }
  }
}

// Onto the grid of its sums (linear/sum_grid.hpp) and back, both exactly; `middles` are 1.5 times
// the powers of the row.
template <int D>
inline void lift(const Row<D>& middles, const double* of_column, Block<D>& block) {
  add_outer(block, middles, of_column);
}
template <int D>
inline void lower(const Row<D>& middles, const double* of_column, Block<D>& block) {
  Row<D> negative;
  set_zero(negative);
  add_scaled(negative, middles, -1.0);
  add_outer(block, negative, of_column);
}
template <int D>
inline Row<D> middles_of(const double* powers) {
  Row<D> row, middles;
  load_row(powers, row);
  set_zero(middles);
  add_scaled(middles, row, 1.5);
  return middles;
}

template <int D, int kFirst = 0>
inline void add_rounded(Row<D, kFirst>& sum,
                        const Row<D, kFirst>& x,
                        const Row<D, kFirst>& middle) {
  if constexpr (kFirst < D) {
    sum.head += (x.head + middle.head) - middle.head;
    add_rounded(sum.tail, x.tail, middle.tail);
  }
}

// block += aᵀ b of two rows of each, rounded to the grid before it is added: what lies halfway goes
// the same way whatever the sum is.
template <int D, int kFirst, int kWidth>
inline void add_outer_on_grid(Block<D, kFirst, kWidth>& block,
                              const Row<D, kFirst> (&a)[2],
                              const double* b,
                              const Row<D, kFirst>& middles,
                              const double* of_column) {
  if constexpr (kFirst < D) {
    if constexpr (kWidth == 1) {
      Row<D> first, second, of_columns, product, middle;
      load_row(b, first);
      load_row(b + D, second);
      load_row(of_column, of_columns);
      set_zero(product);
      set_zero(middle);
      add_scaled(product, first, a[0].head[0]);
      add_scaled(product, second, a[1].head[0]);
      add_scaled(middle, of_columns, middles.head[0]);
      add_rounded(block.row, product, middle);
    } else {
#pragma GCC unroll 18
      for (int c = 0; c < D; ++c) {
        const Pack<kWidth> middle = middles.head * of_column[c];
        const Pack<kWidth> product = a[0].head * b[c] + a[1].head * b[D + c];
        block.columns[c] += (product + middle) - middle;
      }
      const Row<D, kFirst + kWidth> tails[2] = {a[0].tail, a[1].tail};
      add_outer_on_grid(block.rest, tails, b, middles.tail, of_column);
    }
  }
}

// row ← row · x, number by number.
template <int D, int kFirst = 0>
inline void multiply(Row<D, kFirst>& row, const Row<D, kFirst>& x) {
  if constexpr (kFirst < D) {
    row.head = row.head * x.head;
    multiply(row.tail, x.tail);
  }
}

template <int D, int kFirst = 0>
inline double sum_of_row(const Row<D, kFirst>& row) {
  if constexpr (kFirst < D) {
    return sum_of_lanes(row.head) + sum_of_row(row.tail);
  } else {
    return 0.0;
  }
}

template <int D, int kFirst = 0>
inline double dot(const Row<D, kFirst>& a, const Row<D, kFirst>& b) {
  if constexpr (kFirst < D) {
    return sum_of_lanes(a.head * b.head) + dot(a.tail, b.tail);
  } else {
    return 0.0;
  }
}

}  // namespace
}  // namespace sfmcpp::linear::SFMCPP_ISA

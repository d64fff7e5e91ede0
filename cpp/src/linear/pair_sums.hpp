// The blocks of a row of S one after the other, each in registers while its pairs of observations
// are added up. For *_kernels.cpp only: everything lies in the namespace of the instruction set and
// has internal linkage (core/isa.hpp).
#pragma once

#include "stored_observations.hpp"

namespace sfmcpp::linear::SFMCPP_ISA {
namespace {

// Where a D×D block fits into the registers, with what a pair needs beside it.
template <int D>
inline constexpr bool kSumsPairs = SFMCPP_LANES == 8 && D <= 9;

// How many pairs ahead the second observation is prefetched: it lies anywhere in memory.
constexpr int kPairsAhead = 16;

using Eight = Pack<8>;

template <int kLane>
inline Eight broadcast(Eight x) {
  return permuted<kLane, kLane, kLane, kLane, kLane, kLane, kLane, kLane>(x);
}

// Column k of A, its first number and its second number twice in either half.
template <int k>
inline Eight column_of(Eight record) {
  return permuted<k, k, 4 + k, 4 + k, k, k, 4 + k, 4 + k>(record);
}

// −t of an observation (unwhiten), as `coefficients` reads it: column after column.
inline void store_columns(const double* t, double* out) {
  const double columns[8] = {-t[0], -t[3], -t[1], -t[4], -t[2], -t[5], 0.0, 0.0};
  __builtin_memcpy(out, columns, sizeof columns);
}

// Column k of −t four times.
template <int k>
inline Eight repeated_column(Eight columns) {
  constexpr int kFirst = 2 * k, kSecond = 2 * k + 1;
  return permuted<kFirst, kSecond, kFirst, kSecond, kFirst, kSecond, kFirst, kSecond>(columns);
}

// Lane 2 s + r: −t_r · A_s, with row r of the first observation and row s of the second.
inline Eight coefficients(Eight columns, Eight record) {
  return repeated_column<0>(columns) * column_of<0>(record) +
         repeated_column<1>(columns) * column_of<1>(record) +
         repeated_column<2>(columns) * column_of<2>(record);
}

// out = x · first + y · second, with equal lanes in x and in y.
template <int D, int kFirst = 0>
inline void combine(const Row<D, kFirst>& first,
                    const Row<D, kFirst>& second,
                    Eight x,
                    Eight y,
                    Row<D, kFirst>& out) {
  if constexpr (kFirst < D) {
    Pack<Row<D, kFirst>::kWidth> narrow_x, narrow_y;
    __builtin_memcpy(&narrow_x, &x, sizeof narrow_x);
    __builtin_memcpy(&narrow_y, &y, sizeof narrow_y);
    out.head = first.head * narrow_x + second.head * narrow_y;
    combine(first.tail, second.tail, x, y, out.tail);
  }
}

template <int D, class T>
inline void add_pair(const Stored<D, T>& stored,
                     const ObservationPair& pair,
                     const double* columns_of_t,
                     Block<D>& block) {
  const Rows<D> rows(stored.j(pair.first));
  const Eight c =
      coefficients(load<8>(columns_of_t), load<8>(stored.record(pair.second).row[0].by_point));
  const Widened<D, T> j(stored.j(pair.second));
  Row<D> weighted;
  combine(rows.first, rows.second, broadcast<0>(c), broadcast<1>(c), weighted);
  add_outer(block, weighted, j.numbers);
  combine(rows.first, rows.second, broadcast<2>(c), broadcast<3>(c), weighted);
  add_outer(block, weighted, j.numbers + D);
}

// t of the observations of a row, as add_pair reads it.
template <int D, class T>
void whiten_row(const PairSums& in, const Stored<D, T>& stored, const PairSums::Row& row) {
  for (int a = row.begin; a < row.end; ++a) {
    prefetch_factor(in.factors, in.point, a + kFactorsAhead, row.end);
    const PointFactor& m = in.factors[in.point[a]];
    double g[6], t[6];
    whiten(stored.record(a), m, g);
    unwhiten(g, m, t);
    store_columns(t, row.whitened + kWhitenedNumbers * static_cast<long>(a - row.begin));
  }
}

// sum −= Σ J_aᵀ (t_a A_bᵀ) J_b over the pairs of each block.
template <int D, class T>
void sum_pairs(const PairSums& in) {
  const Stored<D, T> stored(in.jacobian);
  for (const PairSums::Row& row : in.rows) whiten_row(in, stored, row);
  const long last = in.blocks.empty() ? 0 : in.blocks.back().end - 1;
  long q = 0;
  for (const PairSums::Block& of : in.blocks) {
    if (q == of.end) continue;
    const PairSums::Row& row = in.rows[of.row];
    const double* grid = in.grid == nullptr ? nullptr : in.grid + static_cast<long>(D) * of.column;
    Row<D> middles;
    set_zero(middles);
    if (grid != nullptr) middles = middles_of<D>(row.grid);
    Block<D> block;
    load_block(of.sum, block);
    if (grid != nullptr) lift(middles, grid, block);
    for (; q < of.end; ++q) {
      const long ahead = q + kPairsAhead;
      stored.prefetch(in.pairs[ahead < last ? ahead : last].second);
      const ObservationPair& pair = in.pairs[q];
      const double* columns_of_t =
          row.whitened + kWhitenedNumbers * static_cast<long>(pair.first - row.begin);
      add_pair(stored, pair, columns_of_t, block);
    }
    if (grid != nullptr) lower(middles, grid, block);
    store_block(block, of.sum);
  }
}

}  // namespace
}  // namespace sfmcpp::linear::SFMCPP_ISA

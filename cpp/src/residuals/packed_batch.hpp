// Packs of a batch's observations; for files compiled once per instruction set.
#pragma once

#include "sfmcpp/core/simd.hpp"
#include "sfmcpp/residuals/reprojection.hpp"

namespace sfmcpp::residuals::SFMCPP_ISA {
namespace {

constexpr int kLanes = SFMCPP_LANES;
static_assert(kLanes <= kReadAhead);
using Real = Pack<kLanes>;

template <int kStorage>
SFMCPP_INLINE void gather_point(const ObservationBatch& batch, int first, Real* point) {
  for (int k = 0; k < kStorage; ++k)
    point[k] = gather<kLanes>(batch.points + k, batch.point + first, kStorage);
}

// Points of the pack after the next: observations lie by camera, and their points anywhere.
template <int kStorage>
SFMCPP_INLINE void prefetch_points(const ObservationBatch& batch, int first) {
  const int ahead = first + 2 * kLanes;
  for (int k = ahead; k < ahead + kLanes && k < batch.count; ++k)
    __builtin_prefetch(batch.points + static_cast<long>(kStorage) * batch.point[k]);
}

[[maybe_unused]] SFMCPP_INLINE int lanes_left(int count, int first) {
  return count - first < kLanes ? count - first : kLanes;
}

// Positive in the lanes that hold an observation, negative beyond the end of the batch.
[[maybe_unused]] SFMCPP_INLINE Real lanes_in_batch(const ObservationBatch& batch, int first) {
  Real left;
  for (int lane = 0; lane < kLanes; ++lane) left.v[lane] = batch.count - first - lane - 0.5;
  return left;
}

// Turns as many columns as there are lanes into that many numbers of each record. Not a member of
// Transposer: GCC 14 takes the same member of transposers of different sizes for one function, and
// then warns of reads beyond the smaller one.
[[maybe_unused]] SFMCPP_INLINE void write_square(const double (*columns)[kLanes],
                                                 int width,
                                                 double* records) {
  Real rows[kLanes];
  for (int c = 0; c < kLanes; ++c) rows[c] = load<kLanes>(columns[c]);
  transpose<kLanes>(rows);
  for (int lane = 0; lane < kLanes; ++lane)
    store(records + static_cast<long>(lane) * width, rows[lane]);
}

// Turns columns of packs into one row-major record per observation.
template <int kMaxColumns>
struct Transposer {
  alignas(64) double columns[kMaxColumns][kLanes];

  void set(int column, Real value) { store(columns[column], value); }

  void write(int width, int lanes, double* records) const {
    int first = 0;
    if (lanes == kLanes) {
      for (; first + kLanes <= width; first += kLanes)
        write_square(columns + first, width, records + first);
    }
    for (int lane = 0; lane < lanes; ++lane) {
      for (int c = first; c < width; ++c)
        records[static_cast<long>(lane) * width + c] = columns[c][lane];
    }
  }
};

}  // namespace
}  // namespace sfmcpp::residuals::SFMCPP_ISA

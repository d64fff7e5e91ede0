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

SFMCPP_INLINE int lanes_left(const ObservationBatch& batch, int first) {
  return batch.count - first < kLanes ? batch.count - first : kLanes;
}

// Positive in the lanes that hold an observation, negative beyond the end of the batch.
[[maybe_unused]] SFMCPP_INLINE Real lanes_in_batch(const ObservationBatch& batch, int first) {
  Real left;
  for (int lane = 0; lane < kLanes; ++lane) left.v[lane] = batch.count - first - lane - 0.5;
  return left;
}

}  // namespace
}  // namespace sfmcpp::residuals::SFMCPP_ISA

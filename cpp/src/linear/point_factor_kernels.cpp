// Compiled once per instruction set; see core/isa.hpp for what may be used here.
#include "sfmcpp/core/simd.hpp"
#include "sfmcpp/linear/schur_kernels.hpp"
#include "sfmcpp/math/inverse_factor.hpp"

namespace sfmcpp::linear::SFMCPP_ISA {
namespace {

constexpr int kLanes = SFMCPP_LANES;
constexpr int kPointNumbers = 9;  // of V and b, and of M and y
using Points = Pack<kLanes>;

// The numbers of some consecutive points, a lane each.
inline void load_points(const double* numbers, Points* columns) {
  int first = 0;
  for (; first + kLanes <= kPointNumbers; first += kLanes) {
    for (int lane = 0; lane < kLanes; ++lane)
      columns[first + lane] = load<kLanes>(numbers + kPointNumbers * lane + first);
    transpose<kLanes>(columns + first);
  }
  for (; first < kPointNumbers; ++first) {
    for (int lane = 0; lane < kLanes; ++lane)
      columns[first].v[lane] = numbers[kPointNumbers * lane + first];
  }
}

inline void store_points(Points* columns, double* numbers) {
  int first = 0;
  for (; first + kLanes <= kPointNumbers; first += kLanes) {
    transpose<kLanes>(columns + first);
    for (int lane = 0; lane < kLanes; ++lane)
      store(numbers + kPointNumbers * lane + first, columns[first + lane]);
  }
  for (; first < kPointNumbers; ++first) {
    for (int lane = 0; lane < kLanes; ++lane)
      numbers[kPointNumbers * lane + first] = columns[first].v[lane];
  }
}

inline void factor_lanes(const double* blocks, double lambda, bool identity, double* factors) {
  Points block[kPointNumbers], damping[3];
  load_points(blocks, block);
  const Points diagonal[3] = {block[0], block[2], block[5]};
  for (int k = 0; k < 3; ++k)
    damping[k] = identity ? Points(lambda) : bounded_diagonal(diagonal[k]) * lambda;
  const InverseFactor<Points> m(block, damping);
  Points y[3];
  multiply_by_factor(m, block + 6, y);
  Points factor[kPointNumbers] = {m.m00, m.m10, m.m11, m.m20, m.m21, m.m22, y[0], y[1], y[2]};
  store_points(factor, factors);
}

void factor_points(
    int n, const double* blocks, double lambda, bool identity, PointFactor* factors) {
  static_assert(sizeof(PointFactor) == kPointNumbers * sizeof(double));
  double rest[kPointNumbers * kLanes] = {}, of_rest[kPointNumbers * kLanes];
  int k = 0;
  for (; k + kLanes <= n; k += kLanes)
    factor_lanes(blocks + kPointNumbers * k, lambda, identity, &factors[k].m00);
  if (k == n) return;
  __builtin_memcpy(rest, blocks + kPointNumbers * k, kPointNumbers * (n - k) * sizeof(double));
  factor_lanes(rest, lambda, identity, of_rest);
  __builtin_memcpy(factors + k, of_rest, kPointNumbers * (n - k) * sizeof(double));
}

}  // namespace

FactorPoints factor_points_kernel() { return &factor_points; }

}  // namespace sfmcpp::linear::SFMCPP_ISA

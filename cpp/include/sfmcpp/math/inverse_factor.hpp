// The inverse of the Cholesky factor of a damped 3×3 matrix, V + λD = L Lᵀ, M = L⁻¹, for one point
// or a pack of them (core/simd.hpp).
#pragma once

#include "sfmcpp/core/simd.hpp"

namespace sfmcpp {

// Of the diagonal D: a parameter that nothing observes still gets a positive damping. Both are far
// outside what any units make of an entry: those of points at a distance of 1e12 are 1e-20, and a
// bound within their reach would make steps depend on units.
inline constexpr double kLeastDiagonal = 1e-32, kMostDiagonal = 1e32;

template <class Real>
SFMCPP_INLINE Real bounded_diagonal(Real entry) {
  const Real most(kMostDiagonal), least(kLeastDiagonal);
  const Real bounded = select_less(most, entry, most, entry);
  return select_less(bounded, least, least, bounded);
}

// 1/√pivot. Pivots below a share of their diagonal entry carry no information: zero, so that the
// point stays where it is along that direction.
template <class Real>
SFMCPP_INLINE Real inverse_root(Real pivot, Real diagonal) {
  const Real least = select_less(Real(0.0), diagonal, diagonal * 1e-13, Real(0.0));
  return select_less(least, pivot, Real(1.0) / square_root(pivot), Real(0.0));
}

template <class Real>
struct InverseFactor {
  Real m00, m10, m11, m20, m21, m22;

  // `v`: the lower triangle of V, row by row; `damping`: the diagonal of λD.
  SFMCPP_INLINE InverseFactor(const Real* v, const Real* damping) {
    const Real d0 = v[0] + damping[0], d1 = v[2] + damping[1], d2 = v[5] + damping[2];
    // L row by row, with reciprocal pivots; then M by forward substitution.
    m00 = inverse_root(d0, d0);
    const Real l10 = v[1] * m00, l20 = v[3] * m00;
    m11 = inverse_root(d1 - l10 * l10, d1);
    const Real l21 = (v[4] - l20 * l10) * m11;
    m22 = inverse_root(d2 - l20 * l20 - l21 * l21, d2);
    m10 = -l10 * m00 * m11;
    m21 = -l21 * m11 * m22;
    m20 = -(l20 * m00 + l21 * m10) * m22;
  }
};

// y = M b, with the entries of M in any struct that names them so.
template <class Factor, class Real>
SFMCPP_INLINE void multiply_by_factor(const Factor& m, const Real* b, Real* y) {
  y[0] = m.m00 * b[0];
  y[1] = m.m10 * b[0] + m.m11 * b[1];
  y[2] = m.m20 * b[0] + m.m21 * b[1] + m.m22 * b[2];
}

// x = Mᵀ y
template <class Factor, class Real>
SFMCPP_INLINE void multiply_by_transposed_factor(const Factor& m, const Real* y, Real* x) {
  x[0] = m.m00 * y[0] + m.m10 * y[1] + m.m20 * y[2];
  x[1] = m.m11 * y[1] + m.m21 * y[2];
  x[2] = m.m22 * y[2];
}

}  // namespace sfmcpp

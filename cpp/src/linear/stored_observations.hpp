// One observation as the kernels of the Schur complement read it. For *_kernels.cpp only:
// everything lies in the namespace of the instruction set and has internal linkage (core/isa.hpp).
#pragma once

#include "register_blocks.hpp"
#include "sfmcpp/linear/schur_kernels.hpp"

namespace sfmcpp::linear::SFMCPP_ISA {
namespace {

// J and A|r of an observation, of D columns in numbers T.
template <int D, class T>
struct Stored {
  const T* by_camera;
  const PointRecordOf<T>* records;

  explicit Stored(const StoredJacobian& all)
      : by_camera(static_cast<const T*>(all.by_camera)),
        records(static_cast<const PointRecordOf<T>*>(all.records)) {}

  const T* j(long a) const { return by_camera + a * 2 * D; }
  const PointRecordOf<T>& record(long a) const { return records[a]; }
  SFMCPP_INLINE void prefetch(long a) const {
    prefetch_numbers<2 * D>(j(a));
    __builtin_prefetch(records + a);
  }
};

// J of one observation as doubles in memory, which broadcasts take their numbers from.
template <int D, class T>
struct Widened {
  alignas(64) double numbers[2 * D];

  explicit Widened(const T* j) {
    Row<2 * D> row;
    load_row(j, row);
    store_row(numbers, row);
  }
};
template <int D>
struct Widened<D, double> {
  const double* numbers;

  explicit Widened(const double* j) : numbers(j) {}
};

// G of one observation from A|r and the factor M of its point: two rows of three.
template <class T>
inline void whiten(const PointRecordOf<T>& record, const PointFactor& m, double* g) {
  for (int row = 0; row < 2; ++row) {
    const T* a = record.row[row].by_point;
    g[3 * row] = a[0] * m.m00;
    g[3 * row + 1] = a[0] * m.m10 + a[1] * m.m11;
    g[3 * row + 2] = a[0] * m.m20 + a[1] * m.m21 + a[2] * m.m22;
  }
}

// How many observations ahead of the one at work the factor of its point is prefetched.
constexpr int kFactorsAhead = 8;

// Of observation a, if it is before `end`: observations lie by camera, and their points anywhere.
SFMCPP_INLINE void prefetch_factor(const PointFactor* factors, const int* point, long a, long end) {
  if (a >= end) return;
  const auto* factor = reinterpret_cast<const char*>(factors + point[a]);
  __builtin_prefetch(factor);
  __builtin_prefetch(factor + sizeof(PointFactor) - 1);
}

template <class T>
inline double dot3(const double* a, const T* b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// J of one observation in registers.
template <int D>
struct Rows {
  Row<D> first, second;

  template <class T>
  explicit Rows(const T* jacobian) {
    load_row(jacobian, first);
    load_row(jacobian + D, second);
  }

  // out = s · first + t · second
  void combine(double s, double t, Row<D>& out) const {
    set_zero(out);
    add_scaled(out, first, s);
    add_scaled(out, second, t);
  }
};

// t = G M: two rows of three. Then G_a G_bᵀ = t_a A_bᵀ, with no loss of accuracy: V* ≥ AᵀA bounds G
// by one, so rounding is of order √cond(V*) either way, and no partner needs whitening.
inline void unwhiten(const double* g, const PointFactor& m, double* t) {
  for (int row = 0; row < 2; ++row) {
    const double* in = g + 3 * row;
    t[3 * row] = in[0] * m.m00 + in[1] * m.m10 + in[2] * m.m20;
    t[3 * row + 1] = in[1] * m.m11 + in[2] * m.m21;
    t[3 * row + 2] = in[2] * m.m22;
  }
}

}  // namespace
}  // namespace sfmcpp::linear::SFMCPP_ISA

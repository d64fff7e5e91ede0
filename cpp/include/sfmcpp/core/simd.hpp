// A pack of doubles that computes like one double. Camera models are templates on their number type:
// with `double` they are the reference, with Pack<8> they treat eight observations at once.
#pragma once

namespace sfmcpp {

// Inlined at any level of optimisation: see the rule in core/isa.hpp.
#define SFMCPP_INLINE [[gnu::always_inline]] inline

// The compiler's vector types; GCC drops the attribute from a type that depends on a parameter.
template <int W>
struct VectorOf;
template <>
struct VectorOf<1> {
  typedef double Type __attribute__((vector_size(8)));
};
template <>
struct VectorOf<2> {
  typedef double Type __attribute__((vector_size(16)));
};
template <>
struct VectorOf<4> {
  typedef double Type __attribute__((vector_size(32)));
};
template <>
struct VectorOf<8> {
  typedef double Type __attribute__((vector_size(64)));
};

template <int W>
struct Pack {
  using Vector = typename VectorOf<W>::Type;
  static constexpr int kLanes = W;
  Vector v;

  Pack() = default;
  SFMCPP_INLINE Pack(double s) : v(Vector{} + s) {}  // NOLINT: a number is a pack of equal numbers
  SFMCPP_INLINE explicit Pack(Vector value) : v(value) {}

  SFMCPP_INLINE friend Pack operator+(Pack a, Pack b) { return Pack(a.v + b.v); }
  SFMCPP_INLINE friend Pack operator-(Pack a, Pack b) { return Pack(a.v - b.v); }
  SFMCPP_INLINE friend Pack operator*(Pack a, Pack b) { return Pack(a.v * b.v); }
  SFMCPP_INLINE friend Pack operator/(Pack a, Pack b) { return Pack(a.v / b.v); }
  SFMCPP_INLINE friend Pack operator-(Pack a) { return Pack(-a.v); }
  SFMCPP_INLINE Pack& operator+=(Pack b) { v += b.v; return *this; }

  SFMCPP_INLINE double operator[](int lane) const { return v[lane]; }
};

template <int W>
SFMCPP_INLINE Pack<W> load(const double* p) {
  Pack<W> r;
  __builtin_memcpy(&r.v, p, sizeof(r.v));
  return r;
}

template <int W>
SFMCPP_INLINE void store(double* p, Pack<W> a) {
  __builtin_memcpy(p, &a.v, sizeof(a.v));
}

// base[stride · index[lane]] in each lane.
template <int W>
SFMCPP_INLINE Pack<W> gather(const double* base, const int* index, int stride) {
  Pack<W> r;
  for (int lane = 0; lane < W; ++lane) r.v[lane] = base[static_cast<long>(stride) * index[lane]];
  return r;
}

}  // namespace sfmcpp

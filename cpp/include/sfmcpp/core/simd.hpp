// A pack of doubles that computes like one double. Camera models are templates on their number
// type: with `double` they are the reference, with Pack<8> they treat eight observations at once.
#pragma once

#include <utility>

namespace sfmcpp {

// Inlined at any level of optimisation: see the rule in core/isa.hpp. What only prefetches needs it
// too: GCC takes it for a function without effect, and drops the calls that are not inlined.
#define SFMCPP_INLINE [[gnu::always_inline]] inline

// So many numbers in memory, by the lines of a cache.
template <int kNumbers, class T>
SFMCPP_INLINE void prefetch_numbers(const T* first) {
  constexpr int kNumbersOfLine = 64 / sizeof(T);
  for (int k = 0; k < kNumbers; k += kNumbersOfLine) __builtin_prefetch(first + k);
}

// The compiler's vector types; GCC drops the attribute from a type that depends on a parameter. A
// vector of one lane it would keep in memory: that is a number.
template <int W>
struct VectorOf;
template <>
struct VectorOf<1> {
  typedef float Single;
  typedef double Type;
};
template <>
struct VectorOf<2> {
  typedef float Single __attribute__((vector_size(8)));
  typedef double Type __attribute__((vector_size(16)));
};
template <>
struct VectorOf<4> {
  typedef float Single __attribute__((vector_size(16)));
  typedef double Type __attribute__((vector_size(32)));
};
template <>
struct VectorOf<8> {
  typedef float Single __attribute__((vector_size(32)));
  typedef double Type __attribute__((vector_size(64)));
};

// The lanes of a vector register, for the instruction set that this file is compiled for.
#if defined(__AVX512F__)
inline constexpr int kRegisterLanes = 8;
#elif defined(__AVX__)
inline constexpr int kRegisterLanes = 4;
#else
inline constexpr int kRegisterLanes = 2;
#endif

// Of one register.
template <int W>
struct Pack {
  using Vector = typename VectorOf<W>::Type;
  static constexpr int kLanes = W;
  Vector v;

  Pack() = default;
  // A number is a pack of equal numbers. Written as s − 0, which compilers fold to a broadcast (0 +
  // s they may not: it turns −0 into 0).
  SFMCPP_INLINE Pack(double s) : v(s - Vector{}) {}  // NOLINT
  SFMCPP_INLINE explicit Pack(Vector value) requires(W > 1) : v(value) {}

  SFMCPP_INLINE friend Pack operator+(Pack a, Pack b) { return Pack(a.v + b.v); }
  SFMCPP_INLINE friend Pack operator-(Pack a, Pack b) { return Pack(a.v - b.v); }
  SFMCPP_INLINE friend Pack operator*(Pack a, Pack b) { return Pack(a.v * b.v); }
  SFMCPP_INLINE friend Pack operator/(Pack a, Pack b) { return Pack(a.v / b.v); }
  SFMCPP_INLINE friend Pack operator-(Pack a) { return Pack(-a.v); }
  SFMCPP_INLINE Pack& operator+=(Pack b) {
    v += b.v;
    return *this;
  }

  SFMCPP_INLINE Pack& operator-=(Pack b) {
    v -= b.v;
    return *this;
  }

  SFMCPP_INLINE double operator[](int lane) const {
    if constexpr (W == 1) {
      return v;
    } else {
      return v[lane];
    }
  }
};

// Of several registers. GCC moves the parts of a vector that is wider than a register through
// memory and general registers (conjugate gradients took twice as long with AVX2).
template <int W>
requires(W > kRegisterLanes) struct Pack<W> {
  static constexpr int kLanes = W;
  using Half = Pack<W / 2>;
  Half low, high;

  Pack() = default;
  SFMCPP_INLINE Pack(double s) : low(s), high(s) {}  // NOLINT
  SFMCPP_INLINE Pack(Half first, Half second) : low(first), high(second) {}

  SFMCPP_INLINE friend Pack operator+(Pack a, Pack b) { return {a.low + b.low, a.high + b.high}; }
  SFMCPP_INLINE friend Pack operator-(Pack a, Pack b) { return {a.low - b.low, a.high - b.high}; }
  SFMCPP_INLINE friend Pack operator*(Pack a, Pack b) { return {a.low * b.low, a.high * b.high}; }
  SFMCPP_INLINE friend Pack operator/(Pack a, Pack b) { return {a.low / b.low, a.high / b.high}; }
  SFMCPP_INLINE friend Pack operator-(Pack a) { return {-a.low, -a.high}; }
  SFMCPP_INLINE Pack& operator+=(Pack b) {
    low += b.low;
    high += b.high;
    return *this;
  }

  SFMCPP_INLINE Pack& operator-=(Pack b) {
    low -= b.low;
    high -= b.high;
    return *this;
  }

  SFMCPP_INLINE double operator[](int lane) const {
    return lane < W / 2 ? low[lane] : high[lane - W / 2];
  }
};

template <int W>
inline constexpr bool kHasHalves = W > kRegisterLanes;

// a < b ? yes : no in each lane; no where either is not a number.
template <int W>
SFMCPP_INLINE Pack<W> select_less(Pack<W> a, Pack<W> b, Pack<W> yes, Pack<W> no) {
  if constexpr (kHasHalves<W>) {
    return {select_less(a.low, b.low, yes.low, no.low),
            select_less(a.high, b.high, yes.high, no.high)};
  } else {
    return Pack<W>(a.v < b.v ? yes.v : no.v);
  }
}
SFMCPP_INLINE double select_less(double a, double b, double yes, double no) {
  return a < b ? yes : no;
}

template <int W>
SFMCPP_INLINE Pack<W> square_root(Pack<W> a) {
  if constexpr (kHasHalves<W>) {
    return {square_root(a.low), square_root(a.high)};
  } else if constexpr (W == 1) {
    return Pack<W>(__builtin_sqrt(a.v));
  } else {
    for (int lane = 0; lane < W; ++lane) a.v[lane] = __builtin_sqrt(a.v[lane]);
    return a;
  }
}
SFMCPP_INLINE double square_root(double a) { return __builtin_sqrt(a); }

// Of numbers in double or single precision.
template <int W, class T>
SFMCPP_INLINE Pack<W> load(const T* p) {
  if constexpr (kHasHalves<W>) {
    return {load<W / 2>(p), load<W / 2>(p + W / 2)};
  } else if constexpr (W == 1) {
    return Pack<W>(static_cast<double>(*p));
  } else if constexpr (sizeof(T) == sizeof(double)) {
    Pack<W> r;
    __builtin_memcpy(&r.v, p, sizeof(r.v));
    return r;
  } else {
    typename VectorOf<W>::Single narrow;
    __builtin_memcpy(&narrow, p, sizeof(narrow));
    return Pack<W>(__builtin_convertvector(narrow, typename VectorOf<W>::Type));
  }
}

template <int W, class T>
SFMCPP_INLINE void store(T* p, Pack<W> a) {
  if constexpr (kHasHalves<W>) {
    store(p, a.low);
    store(p + W / 2, a.high);
  } else if constexpr (W == 1) {
    *p = static_cast<T>(a.v);
  } else if constexpr (sizeof(T) == sizeof(double)) {
    __builtin_memcpy(p, &a.v, sizeof(a.v));
  } else {
    const auto narrow = __builtin_convertvector(a.v, typename VectorOf<W>::Single);
    __builtin_memcpy(p, &narrow, sizeof(narrow));
  }
}

// Sum over the lanes, halves first: the same order for every width of register.
template <int W>
SFMCPP_INLINE double sum_of_lanes(Pack<W> a) {
  if constexpr (W == 1) {
    return a.v;
  } else if constexpr (kHasHalves<W>) {
    return sum_of_lanes(a.low + a.high);
  } else {
    Pack<W / 2> low, high;
    __builtin_memcpy(&low.v, &a.v, sizeof(low.v));
    __builtin_memcpy(&high.v, reinterpret_cast<const char*>(&a.v) + sizeof(low.v), sizeof(high.v));
    return sum_of_lanes(low + high);
  }
}

// The lanes of a and b in the order given, those of b counted on from those of a.
template <int... kLanes, class Vector>
SFMCPP_INLINE Vector shuffled(Vector a, Vector b) {
#if defined(__clang__) || __GNUC__ >= 12
  return __builtin_shufflevector(a, b, kLanes...);
#else
  typedef long long Order __attribute__((vector_size(sizeof(Vector))));
  return __builtin_shuffle(a, b, Order{kLanes...});
#endif
}

// The lanes of a in the order given.
template <int... kLane, int W>
SFMCPP_INLINE Pack<W> permuted(Pack<W> a) {
  if constexpr (kHasHalves<W>) {
    double numbers[W];
    store(numbers, a);
    const double in_order[W] = {numbers[kLane]...};
    return load<W>(in_order);
  } else {
    return Pack<W>(shuffled<kLane...>(a.v, a.v));
  }
}

template <int kStride, int W, int... kLane>
SFMCPP_INLINE void exchange_lanes(Pack<W>& a, Pack<W>& b, std::integer_sequence<int, kLane...>) {
  const Pack<W> low(shuffled<((kLane & kStride) != 0 ? W + kLane - kStride : kLane)...>(a.v, b.v));
  const Pack<W> high(shuffled<((kLane & kStride) != 0 ? W + kLane : kLane + kStride)...>(a.v, b.v));
  a = low;
  b = high;
}

// Exchanges the upper half of `a` with the lower half of `b`, in each group of 2 kStride lanes.
template <int kStride, int W>
SFMCPP_INLINE void exchange_halves(Pack<W>& a, Pack<W>& b) {
  if constexpr (!kHasHalves<W>) {
    exchange_lanes<kStride>(a, b, std::make_integer_sequence<int, W>());
  } else if constexpr (kStride == W / 2) {
    std::swap(a.high, b.low);
  } else {
    exchange_halves<kStride>(a.low, b.low);
    exchange_halves<kStride>(a.high, b.high);
  }
}

// Exchanges the off-diagonal halves of every pair of rows that are kStride apart (Eklundh's
// transpose).
template <int W, int kStride>
SFMCPP_INLINE void exchange(Pack<W>* rows) {
  for (int i = 0; i < W; ++i) {
    if ((i & kStride) != 0) continue;
    exchange_halves<kStride>(rows[i], rows[i + kStride]);
  }
  if constexpr (kStride > 1) exchange<W, kStride / 2>(rows);
}

// Transposes W rows of W lanes.
template <int W>
SFMCPP_INLINE void transpose(Pack<W>* rows) {
  if constexpr (W > 1) exchange<W, W / 2>(rows);
}

// base[stride · index[lane]] in each lane.
template <int W>
SFMCPP_INLINE Pack<W> gather(const double* base, const int* index, int stride) {
  if constexpr (kHasHalves<W>) {
    return {gather<W / 2>(base, index, stride), gather<W / 2>(base, index + W / 2, stride)};
  } else {
    Pack<W> r;
    for (int lane = 0; lane < W; ++lane) r.v[lane] = base[static_cast<long>(stride) * index[lane]];
    return r;
  }
}

}  // namespace sfmcpp

// Compiled once per instruction set; see core/isa.hpp for what may be used here.
#include "sfmcpp/features/nearest_kernels.hpp"

#include "sfmcpp/core/simd.hpp"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace sfmcpp::features::SFMCPP_ISA {
namespace {

typedef int Ints __attribute__((vector_size(8 * SFMCPP_LANES)));
constexpr int kLanes = 2 * SFMCPP_LANES;
// A tile of products that stays in registers: 32 of them with AVX-512, else 16.
constexpr int kRows = SFMCPP_LANES == 8 ? 6 : 4;
constexpr int kVectors = SFMCPP_LANES == 8 ? 4 : 2;
constexpr int kColumns = kVectors * kLanes;

SFMCPP_INLINE Ints load(const void* p) {
  Ints v;
  __builtin_memcpy(&v, p, sizeof(v));
  return v;
}
SFMCPP_INLINE void store(int* p, Ints v) { __builtin_memcpy(p, &v, sizeof(v)); }
SFMCPP_INLINE Ints all(int value) { return Ints{} + value; }
SFMCPP_INLINE Ints smaller(Ints a, Ints b) { return a < b ? a : b; }
SFMCPP_INLINE Ints larger(Ints a, Ints b) { return a < b ? b : a; }

// Pairs of 16-bit numbers.
struct WordProducts {
  static constexpr bool kInBytes = false;

  SFMCPP_INLINE static void add(Ints& sum, Ints a, Ints b) {
#if defined(__x86_64__) && SFMCPP_LANES == 8
    sum += Ints(_mm512_madd_epi16(__m512i(a), __m512i(b)));
#elif defined(__x86_64__) && SFMCPP_LANES == 4
    sum += Ints(_mm256_madd_epi16(__m256i(a), __m256i(b)));
#elif defined(__x86_64__)
    sum += Ints(_mm_madd_epi16(__m128i(a), __m128i(b)));
#else
    sum += (a >> 16) * (b >> 16) + (a & 0xffff) * (b & 0xffff);
#endif
  }
};

// Fours of signed bytes a and unsigned b. Not by the intrinsics: the instruction is in a set of its
// own, which the rest of this file must do without.
struct ByteProducts {
  static constexpr bool kInBytes = true;

  SFMCPP_INLINE static void add(Ints& sum, Ints a, Ints b) {
#if defined(__x86_64__) && SFMCPP_LANES == 8
    asm("vpdpbusd %1, %2, %0" : "+v"(sum) : "v"(a), "v"(b));
#elif defined(__x86_64__) && SFMCPP_LANES == 4
    asm("%{vex%} vpdpbusd %1, %2, %0" : "+x"(sum) : "x"(a), "x"(b));
#else
    WordProducts::add(sum, a, b);
#endif
  }
};

// Clang before version 18 has no name for the second feature: it takes products of words there.
bool has_byte_products() {
#if defined(__x86_64__) && SFMCPP_LANES == 8
  return __builtin_cpu_supports("avx512vnni");
#elif defined(__x86_64__) && SFMCPP_LANES == 4 && (!defined(__clang__) || __clang_major__ >= 18)
  return __builtin_cpu_supports("avxvnni");
#else
  return false;
#endif
}

struct Minima {
  Ints best, second, index;

  // Of equal ones the first stays.
  SFMCPP_INLINE void take(Ints distance, Ints number) {
    index = distance < best ? number : index;
    second = smaller(second, larger(distance, best));
    best = smaller(best, distance);
  }
};

SFMCPP_INLINE Minima load(const Smallest& from, long at) {
  return {load(from.best + at), load(from.second + at), load(from.index + at)};
}
SFMCPP_INLINE void store(const Smallest& to, long at, const Minima& minima) {
  store(to.best + at, minima.best);
  store(to.second + at, minima.second);
  store(to.index + at, minima.index);
}

template <class Products>
SFMCPP_INLINE void multiply(const PanelTask& task,
                            const std::uint32_t* rows,
                            Ints (&sum)[kRows][kVectors]) {
  for (auto& row : sum) {
    for (Ints& s : row) s = Ints{};
  }
  const std::uint32_t* panel = task.panel;
  for (int group = 0; group < task.num_groups; ++group, rows += kRows, panel += kColumns) {
    Ints b[kVectors];
#pragma GCC unroll 8
    for (int v = 0; v < kVectors; ++v) b[v] = load(panel + v * kLanes);
#pragma GCC unroll 8
    for (int i = 0; i < kRows; ++i) {
      const Ints a = all(static_cast<int>(rows[i]));
#pragma GCC unroll 8
      for (int v = 0; v < kVectors; ++v) Products::add(sum[i][v], a, b[v]);
    }
  }
}

template <class Products, bool kBothWays>
void nearest(const PanelTask& task) {
  Ints number[kVectors], term[kVectors];
  Minima column[kVectors];
#pragma GCC unroll 8
  for (int v = 0; v < kVectors; ++v) {
    for (int lane = 0; lane < kLanes; ++lane)
      number[v][lane] = task.first_column + v * kLanes + lane;
    term[v] = load(task.panel_terms + v * kLanes);
    column[v] = {all(kPadding), all(kPadding), all(-1)};
  }
  for (int first = 0; first < task.num_rows; first += kRows) {
    Ints sum[kRows][kVectors];
    multiply<Products>(task, task.rows + static_cast<long>(first) * task.num_groups, sum);
#pragma GCC unroll 8
    for (int i = 0; i < kRows; ++i) {
      const int row_term = task.row_terms[first + i];
      Minima row = load(task.of_rows, static_cast<long>(first + i) * kLanes);
#pragma GCC unroll 8
      for (int v = 0; v < kVectors; ++v) {
        const Ints distance = (term[v] + row_term) - (sum[i][v] + sum[i][v]);
        row.take(distance, number[v]);
        if constexpr (kBothWays) column[v].take(distance, all(task.first_row + first + i));
      }
      store(task.of_rows, static_cast<long>(first + i) * kLanes, row);
    }
  }
  if constexpr (kBothWays) {
    for (int v = 0; v < kVectors; ++v) store(task.of_columns, v * kLanes, column[v]);
  }
}

template <class Products>
NearestKernels kernels_with() {
  return {kLanes,
          kRows,
          kColumns,
          Products::kInBytes,
          &nearest<Products, true>,
          &nearest<Products, false>};
}

}  // namespace

NearestKernels nearest_kernels_of(bool byte_products) {
  return byte_products && has_byte_products() ? kernels_with<ByteProducts>()
                                              : kernels_with<WordProducts>();
}

}  // namespace sfmcpp::features::SFMCPP_ISA

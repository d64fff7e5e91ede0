// Compiled once per instruction set; see core/isa.hpp for what may be used here.
#include "sfmcpp/linear/cholesky_kernels.hpp"

#include "sfmcpp/core/simd.hpp"

namespace sfmcpp::linear::SFMCPP_ISA {
namespace {

constexpr int kLanes = SFMCPP_LANES;
using Real = Pack<kLanes>;

// A tile of c that stays in registers: two packs of rows by as many columns as there is room for.
constexpr int kTileRows = 2 * kLanes;
constexpr int kTileColumns = kLanes == 8 ? 8 : 4;

// Columns of a are `lda` apart, of b `ldb`, of c `ld`.
inline void update_tile(
    const double* a, long lda, const double* b, long ldb, double* c, long ld, int inner) {
  Real low[kTileColumns], high[kTileColumns];
#pragma GCC unroll 8
  for (int j = 0; j < kTileColumns; ++j) {
    low[j] = load<kLanes>(c + j * ld);
    high[j] = load<kLanes>(c + j * ld + kLanes);
  }
  for (int p = 0; p < inner; ++p) {
    const Real a_low = load<kLanes>(a + p * lda), a_high = load<kLanes>(a + p * lda + kLanes);
#pragma GCC unroll 8
    for (int j = 0; j < kTileColumns; ++j) {
      const Real factor = b[p * ldb + j];
      low[j] -= a_low * factor;
      high[j] -= a_high * factor;
    }
  }
#pragma GCC unroll 8
  for (int j = 0; j < kTileColumns; ++j) {
    store(c + j * ld, low[j]);
    store(c + j * ld + kLanes, high[j]);
  }
}

void update(const double* a, const double* b, double* c, long ld, int inner, int columns) {
  for (int j = 0; j < columns; j += kTileColumns) {
    for (int i = 0; i < kStrip; i += kTileRows)
      update_tile(a + i, ld, b + j, ld, c + i + j * ld, ld, inner);
  }
}

void pack(const double* a, long ld, int rows, int inner, double* packed) {
  for (int row = 0; row < rows; row += kStrip) {
    for (int p = 0; p < inner; ++p) {
      for (int i = 0; i < kStrip; i += kLanes)
        store(packed + i, load<kLanes>(a + row + i + p * ld));
      packed += kStrip;
    }
  }
}

void update_packed(const double* a, const double* b, double* c, long ld, int inner, int columns) {
  for (int j = 0; j < columns; j += kTileColumns) {
    const double* columns_of_b = b + static_cast<long>(j / kStrip * kStrip) * inner + j % kStrip;
    for (int i = 0; i < kStrip; i += kTileRows)
      update_tile(a + i, kStrip, columns_of_b, kStrip, c + i + j * ld, ld, inner);
  }
}

// A factor of one panel, out of the way of what is written.
struct PanelFactor {
  double l[kPanel][kPanel];  // row, column
  double inverse_diagonal[kPanel];

  PanelFactor(const double* factor, long ld) {
    for (int j = 0; j < kPanel; ++j) {
      for (int p = 0; p <= j; ++p) l[j][p] = factor[j + p * ld];
      inverse_diagonal[j] = 1.0 / l[j][j];
    }
  }
  void restore(double* factor, long ld) const {
    for (int j = 0; j < kPanel; ++j) {
      for (int p = 0; p <= j; ++p) factor[j + p * ld] = l[j][p];
    }
  }
};

// x ← x l⁻ᵀ for kPanel columns of one strip.
inline void solve_panel(const PanelFactor& factor, double* x, long ld) {
  for (int i = 0; i < kStrip; i += kLanes) {
    Real column[kPanel];
#pragma GCC unroll 8
    for (int j = 0; j < kPanel; ++j) {
      Real sum = load<kLanes>(x + i + j * ld);
      for (int p = 0; p < j; ++p) sum -= column[p] * factor.l[j][p];
      column[j] = sum * factor.inverse_diagonal[j];
      store(x + i + j * ld, column[j]);
    }
  }
}

void solve_strip(const double* l, double* x, long ld, int size) {
  for (int j = 0; j < size; j += kPanel) {
    update(x, l + j, x + j * ld, ld, j, kPanel);
    solve_panel(PanelFactor(l + j + j * ld, ld), x + j * ld, ld);
  }
}

bool factor_panel(double* a, long ld) {
  for (int j = 0; j < kPanel; ++j) {
    double pivot = a[j + j * ld];
    for (int p = 0; p < j; ++p) pivot -= a[j + p * ld] * a[j + p * ld];
    if (!(pivot > 0.0)) return false;
    const double root = __builtin_sqrt(pivot);
    a[j + j * ld] = root;
    for (int i = j + 1; i < kPanel; ++i) {
      double sum = a[i + j * ld];
      for (int p = 0; p < j; ++p) sum -= a[i + p * ld] * a[j + p * ld];
      a[i + j * ld] = sum / root;
    }
  }
  return true;
}

// Left-looking by panels. A strip may begin above or on the panel's diagonal block; of what it
// writes there only the factor itself is read again, and that is restored.
bool factor(double* a, long ld, int size) {
  for (int j = 0; j < size; j += kPanel) {
    const int first = j / kStrip * kStrip;
    for (int i = first; i < size; i += kStrip) update(a + i, a + j, a + i + j * ld, ld, j, kPanel);
    double* diagonal = a + j + j * ld;
    if (!factor_panel(diagonal, ld)) return false;
    const PanelFactor panel(diagonal, ld);
    for (int i = first; i < size; i += kStrip) solve_panel(panel, a + i + j * ld, ld);
    panel.restore(diagonal, ld);
  }
  return true;
}

void add_runs(const double* source, double* target, const RowRun* runs, int begin, int end) {
  for (; begin < end; ++runs) {
    const int stop = runs->source + runs->length < end ? runs->source + runs->length : end;
    double* to = target + (runs->target - runs->source);
    int row = begin > runs->source ? begin : runs->source;
    for (; row + kLanes <= stop; row += kLanes)
      store(to + row, load<kLanes>(to + row) + load<kLanes>(source + row));
    for (; row < stop; ++row) to[row] += source[row];
    begin = stop;
  }
}

// Four columns at a time: x is loaded and stored once for them.
constexpr int kColumnsAtOnce = 4;

// x[i] −= Σ s[c] l[i + c ld] for i in [begin, size).
inline void subtract_columns(
    const double* l, long ld, const double* s, int begin, int size, double* x) {
  int i = begin;
  for (; i + kLanes <= size; i += kLanes) {
    Real sum = load<kLanes>(x + i);
    for (int c = 0; c < kColumnsAtOnce; ++c) sum -= load<kLanes>(l + i + c * ld) * s[c];
    store(x + i, sum);
  }
  for (; i < size; ++i) {
    for (int c = 0; c < kColumnsAtOnce; ++c) x[i] -= s[c] * l[i + c * ld];
  }
}

// sums[c] = Σ l[i + c ld] x[i] for i in [begin, size).
inline void dot_columns(
    const double* l, long ld, const double* x, int begin, int size, double* sums) {
  Real sum[kColumnsAtOnce];
  for (int c = 0; c < kColumnsAtOnce; ++c) sum[c] = Real(0.0);
  int i = begin;
  for (; i + kLanes <= size; i += kLanes) {
    const Real values = load<kLanes>(x + i);
    for (int c = 0; c < kColumnsAtOnce; ++c) sum[c] += load<kLanes>(l + i + c * ld) * values;
  }
  for (int c = 0; c < kColumnsAtOnce; ++c) {
    sums[c] = sum_of_lanes(sum[c]);
    for (int k = i; k < size; ++k) sums[c] += l[k + c * ld] * x[k];
  }
}

void forward(const double* l, long ld, int columns, int rows, double* x) {
  int j = 0;
  for (; j + kColumnsAtOnce <= columns; j += kColumnsAtOnce) {
    const double* part = l + j * ld;
    for (int c = 0; c < kColumnsAtOnce; ++c) {
      for (int p = 0; p < c; ++p) x[j + c] -= part[j + c + p * ld] * x[j + p];
      x[j + c] /= part[j + c + c * ld];
    }
    subtract_columns(part, ld, x + j, j + kColumnsAtOnce, rows, x);
  }
  for (; j < columns; ++j) {
    x[j] /= l[j + j * ld];
    for (int i = j + 1; i < rows; ++i) x[i] -= l[i + j * ld] * x[j];
  }
}

void backward(const double* l, long ld, int columns, int rows, double* x) {
  int j = columns;
  for (; j % kColumnsAtOnce != 0; --j) {
    double sum = x[j - 1];
    for (int i = j; i < rows; ++i) sum -= l[i + (j - 1) * ld] * x[i];
    x[j - 1] = sum / l[(j - 1) * (ld + 1)];
  }
  while (j > 0) {
    j -= kColumnsAtOnce;
    const double* part = l + j * ld;
    double sums[kColumnsAtOnce];
    dot_columns(part, ld, x, j + kColumnsAtOnce, rows, sums);
    for (int c = kColumnsAtOnce - 1; c >= 0; --c) {
      double sum = x[j + c] - sums[c];
      for (int i = c + 1; i < kColumnsAtOnce; ++i) sum -= part[j + i + c * ld] * x[j + i];
      x[j + c] = sum / part[j + c + c * ld];
    }
  }
}

constexpr int kPacks = kStrip / kLanes;  // of a column of a strip

void forward_strip(const double* l, int first, int strip, double* x) {
  const double* columns = l + strip_begin(strip);
  const int end = kStrip * strip;
  Real rest[kPacks];
  for (int i = 0; i < kPacks; ++i) rest[i] = load<kLanes>(x + end + kLanes * i);
  for (int c = kStrip * first; c < end; ++c) {
    for (int i = 0; i < kPacks; ++i)
      rest[i] -= load<kLanes>(columns + kStrip * c + kLanes * i) * x[c];
  }
  double* y = x + end;
  for (int i = 0; i < kPacks; ++i) store(y + kLanes * i, rest[i]);
  const double* square = l + strip_begin(strip, strip);
  for (int j = 0; j < kStrip; ++j, square += kStrip) {
    y[j] /= square[j];
    for (int i = j + 1; i < kStrip; ++i) y[i] -= square[i] * y[j];
  }
}

void backward_strip(const double* l, int strip, int num_strips, double* x) {
  constexpr int kEights = kStrip / 8;
  Pack<8> sums[kStrip];
  for (Pack<8>& sum : sums) sum = Pack<8>(0.0);
  for (int s = strip + 1; s < num_strips; ++s) {
    const double* column = l + strip_begin(s, strip);
    for (int i = 0; i < kEights; ++i) {
      const Pack<8> values = load<8>(x + kStrip * s + 8 * i);
#pragma GCC unroll 16
      for (int j = 0; j < kStrip; ++j) sums[j] += load<8>(column + kStrip * j + 8 * i) * values;
    }
  }
  const double* square = l + strip_begin(strip, strip);
  double* y = x + kStrip * strip;
  for (int j = kStrip - 1; j >= 0; --j) {
    double rest = y[j] - sum_of_lanes(sums[j]);
    for (int i = j + 1; i < kStrip; ++i) rest -= square[i + kStrip * j] * y[i];
    y[j] = rest / square[j + kStrip * j];
  }
}

}  // namespace

CholeskyKernels cholesky_kernels_of() {
  return {.update = &update,
          .pack = &pack,
          .update_packed = &update_packed,
          .factor = &factor,
          .solve_strip = &solve_strip,
          .add_runs = &add_runs,
          .forward = &forward,
          .backward = &backward,
          .forward_strip = &forward_strip,
          .backward_strip = &backward_strip};
}

}  // namespace sfmcpp::linear::SFMCPP_ISA

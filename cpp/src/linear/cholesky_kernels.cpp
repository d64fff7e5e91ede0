// Compiled once per instruction set; see core/isa.hpp for what may be used here.
#include "sfmcpp/core/simd.hpp"
#include "sfmcpp/linear/cholesky_isa.hpp"

namespace sfmcpp::linear::SFMCPP_ISA {
namespace {

constexpr int kLanes = SFMCPP_LANES;
using Real = Pack<kLanes>;

// A tile of c that stays in registers: two packs of rows by as many columns as there is room for.
constexpr int kTileRows = 2 * kLanes;
constexpr int kTileColumns = kLanes == 8 ? 8 : 4;

inline void update_tile(const double* a, const double* b, double* c, long ld, int inner) {
  Real low[kTileColumns], high[kTileColumns];
#pragma GCC unroll 8
  for (int j = 0; j < kTileColumns; ++j) {
    low[j] = load<kLanes>(c + j * ld);
    high[j] = load<kLanes>(c + j * ld + kLanes);
  }
  for (int p = 0; p < inner; ++p) {
    const Real a_low = load<kLanes>(a + p * ld), a_high = load<kLanes>(a + p * ld + kLanes);
#pragma GCC unroll 8
    for (int j = 0; j < kTileColumns; ++j) {
      const Real factor = -b[p * ld + j];
      low[j] += a_low * factor;
      high[j] += a_high * factor;
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
      update_tile(a + i, b + j, c + i + j * ld, ld, inner);
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
      for (int p = 0; p < j; ++p) sum += column[p] * -factor.l[j][p];
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

// x[i] += s · column[i] for i in [begin, size).
inline void add_scaled(const double* column, double s, int begin, int size, double* x) {
  int i = begin;
  for (; i + kLanes <= size; i += kLanes)
    store(x + i, load<kLanes>(x + i) + load<kLanes>(column + i) * s);
  for (; i < size; ++i) x[i] += column[i] * s;
}

inline double dot(const double* column, const double* x, int begin, int size) {
  Real sum(0.0);
  int i = begin;
  for (; i + kLanes <= size; i += kLanes) sum += load<kLanes>(column + i) * load<kLanes>(x + i);
  double total = sum_of_lanes(sum);
  for (; i < size; ++i) total += column[i] * x[i];
  return total;
}

void forward(const double* l, long ld, int size, double* x) {
  for (int j = 0; j < size; ++j) {
    x[j] /= l[j + j * ld];
    add_scaled(l + j * ld, -x[j], j + 1, size, x);
  }
}

void backward(const double* l, long ld, int size, double* x) {
  for (int j = size - 1; j >= 0; --j)
    x[j] = (x[j] - dot(l + j * ld, x, j + 1, size)) / l[j + j * ld];
}

}  // namespace

CholeskyKernels cholesky_kernels_of() {
  return {.update = &update,
          .factor = &factor,
          .solve_strip = &solve_strip,
          .forward = &forward,
          .backward = &backward};
}

}  // namespace sfmcpp::linear::SFMCPP_ISA

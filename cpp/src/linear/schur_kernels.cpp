// Compiled once per instruction set; see core/isa.hpp for what may be used here.
#include "sfmcpp/core/simd.hpp"
#include "sfmcpp/linear/panel_layout.hpp"
#include "sfmcpp/linear/schur_isa.hpp"

namespace sfmcpp::linear::SFMCPP_ISA {
namespace {

// A row of D numbers in vector registers of panel widths.
template <int D, int kFirst = 0>
struct Row {
  static constexpr int kWidth = panel_width(D - kFirst);
  Pack<kWidth> head;
  Row<D, kFirst + kWidth> tail;
};
template <int D>
struct Row<D, D> {};

template <int D, int kFirst = 0>
inline void load_row(const double* p, Row<D, kFirst>& row, double factor = 1.0) {
  if constexpr (kFirst < D) {
    row.head = load<Row<D, kFirst>::kWidth>(p + kFirst) * factor;
    load_row(p, row.tail, factor);
  }
}

template <int D, int kFirst = 0>
inline void store_row(double* p, const Row<D, kFirst>& row) {
  if constexpr (kFirst < D) {
    store(p + kFirst, row.head);
    store_row(p, row.tail);
  }
}

template <int D, int kFirst = 0>
inline void set_zero(Row<D, kFirst>& row) {
  if constexpr (kFirst < D) {
    row.head = Pack<Row<D, kFirst>::kWidth>(0.0);
    set_zero(row.tail);
  }
}

// row += x · s
template <int D, int kFirst = 0>
inline void add_scaled(Row<D, kFirst>& row, const Row<D, kFirst>& x, double s) {
  if constexpr (kFirst < D) {
    row.head += x.head * s;
    add_scaled(row.tail, x.tail, s);
  }
}

template <int D, int kFirst = 0>
inline void add_squares(Row<D, kFirst>& row, const Row<D, kFirst>& x) {
  if constexpr (kFirst < D) {
    row.head += x.head * x.head;
    add_squares(row.tail, x.tail);
  }
}

// block += Σ_k a_kᵀ b_k: the rows of a lie in registers, the numbers of b (rank × D) are broadcast.
// A panel one row high is a plain row of the block: there b is what is loaded as vectors.
template <int D, int kRank, int kFirst = 0>
inline void rank_update(const Row<D, kFirst>* const (&a)[kRank], const double* b, double* block) {
  if constexpr (kFirst < D) {
    constexpr int kWidth = Row<D, kFirst>::kWidth;
    double* panel = block + kFirst * D;
    if constexpr (kWidth == 1) {
      Row<D> sum;
      load_row(panel, sum);
      for (int k = 0; k < kRank; ++k) {
        Row<D> row;
        load_row(b + k * D, row);
        add_scaled(sum, row, a[k]->head[0]);
      }
      store_row(panel, sum);
    } else {
      for (int c = 0; c < D; ++c) {
        Pack<kWidth> sum = load<kWidth>(panel + c * kWidth);
        for (int k = 0; k < kRank; ++k) sum += a[k]->head * b[k * D + c];
        store(panel + c * kWidth, sum);
      }
    }
    const Row<D, kFirst + kWidth>* rest[kRank];
    for (int k = 0; k < kRank; ++k) rest[k] = &a[k]->tail;
    rank_update<D, kRank>(rest, b, block);
  }
}

// A whole block in registers, for sums over many observations; the same panels.
template <int D, int kFirst = 0, int kWidth = panel_width(D - kFirst)>
struct Block {
  Pack<kWidth> columns[D];
  Block<D, kFirst + kWidth> rest;
};
template <int D, int kFirst>
struct Block<D, kFirst, 1> {
  Row<D> row;
};
template <int D>
struct Block<D, D, 1> {};

// block += aᵀ b with one row each; `b` in memory.
template <int D, int kFirst, int kWidth>
inline void add_outer(Block<D, kFirst, kWidth>& block, const Row<D, kFirst>& a, const double* b) {
  if constexpr (kFirst < D) {
    if constexpr (kWidth == 1) {
      Row<D> row;
      load_row(b, row);
      add_scaled(block.row, row, a.head[0]);
    } else {
#pragma GCC unroll 18
      for (int c = 0; c < D; ++c) block.columns[c] += a.head * b[c];
      add_outer(block.rest, a.tail, b);
    }
  }
}

template <int D, int kFirst, int kWidth>
inline void set_zero(Block<D, kFirst, kWidth>& block) {
  if constexpr (kFirst < D) {
    if constexpr (kWidth == 1) {
      set_zero(block.row);
    } else {
      for (int c = 0; c < D; ++c) block.columns[c] = Pack<kWidth>(0.0);
      set_zero(block.rest);
    }
  }
}

template <int D, int kFirst, int kWidth>
inline void store_block(const Block<D, kFirst, kWidth>& block, double* out) {
  if constexpr (kFirst < D) {
    if constexpr (kWidth == 1) {
      store_row(out + kFirst * D, block.row);
    } else {
      for (int c = 0; c < D; ++c) store(out + kFirst * D + c * kWidth, block.columns[c]);
      store_block(block.rest, out);
    }
  }
}

// block += factor · aᵀ a with a of kRank rows.
template <int D, int kRank>
inline void add_square(const double* a, double factor, Block<D>& block) {
  for (int k = 0; k < kRank; ++k) {
    Row<D> row;
    load_row(a + k * D, row, factor);
    add_outer(block, row, a + k * D);
  }
}

template <int D>
void camera_gradient(int n, const double* jacobian, const double* records, double* gradient,
                     double* diagonal) {
  Row<D> sum, squares;
  load_row(gradient, sum);
  load_row(diagonal, squares);
  for (int a = 0; a < n; ++a) {
    for (int row = 0; row < 2; ++row) {
      Row<D> j;
      load_row(jacobian + (2L * a + row) * D, j);
      add_scaled(sum, j, records[kPointRecord * static_cast<long>(a) + 4 * row + 3]);
      add_squares(squares, j);
    }
  }
  store_row(gradient, sum);
  store_row(diagonal, squares);
}

// G of one observation from A|r and the factor M of its point.
inline void whiten_one(const double* record, const double* m, double* whitened) {
  for (int row = 0; row < 2; ++row) {
    const double* in = record + 4 * row;
    double* g = whitened + 3 * row;
    g[0] = in[0] * m[0];
    g[1] = in[0] * m[1] + in[1] * m[2];
    g[2] = in[0] * m[3] + in[1] * m[4] + in[2] * m[5];
  }
}

void whiten(int n, const double* records, const int* point, const double* factors, double* whitened) {
  for (long a = 0; a < n; ++a) {
    whiten_one(records + kPointRecord * a, factors + static_cast<long>(kPointFactor) * point[a],
               whitened + kWhitenedPoint * a);
  }
}

// P = Gᵀ J of one observation.
template <int D>
inline void couple_one(const double* jacobian, const double* g, double* coupling) {
  Row<D> j0, j1;
  load_row(jacobian, j0);
  load_row(jacobian + D, j1);
  for (int k = 0; k < 3; ++k) {
    Row<D> p;
    set_zero(p);
    add_scaled(p, j0, g[k]);
    add_scaled(p, j1, g[3 + k]);
    store_row(coupling + k * D, p);
  }
}

template <int D>
void couple(int n, const double* records, const int* point, const double* factors, const double* jacobian,
            double* coupling) {
  for (long a = 0; a < n; ++a) {
    double g[kWhitenedPoint];
    whiten_one(records + kPointRecord * a, factors + static_cast<long>(kPointFactor) * point[a], g);
    couple_one<D>(jacobian + a * 2 * D, g, coupling + a * 3 * D);
  }
}

// block = Σ Jᵀ J − Pᵀ P and rhs = −Σ Pᵀ y over n observations, with P given by p(a).
template <int D, class Coupling>
inline void diagonal_and_rhs(long n, const double* jacobian, const int* point, const double* factors,
                             const Coupling& p, double* diagonal, double* rhs) {
  Block<D> block;
  set_zero(block);
  Row<D> sum;
  set_zero(sum);
  for (long a = 0; a < n; ++a) {
    add_square<D, 2>(jacobian + a * 2 * D, 1.0, block);
    const double* coupling = p(a);
    add_square<D, 3>(coupling, -1.0, block);
    const double* y = factors + static_cast<long>(kPointFactor) * point[a] + 6;
    for (int k = 0; k < 3; ++k) {
      Row<D> row;
      load_row(coupling + k * D, row);
      add_scaled(sum, row, -y[k]);
    }
  }
  store_block(block, diagonal);
  store_row(rhs, sum);
}

template <int D>
void schur_diagonal(int n, const double* jacobian, const double* whitened, const int* point,
                    const double* factors, double* diagonal, double* rhs) {
  double buffer[3 * D];
  const auto coupling = [&](long a) {
    couple_one<D>(jacobian + a * 2 * D, whitened + a * kWhitenedPoint, buffer);
    return static_cast<const double*>(buffer);
  };
  diagonal_and_rhs<D>(n, jacobian, point, factors, coupling, diagonal, rhs);
}

// Asks for the coupling blocks that observation a will meet. They lie anywhere in memory, and waiting
// for them took longer than the arithmetic.
template <int D>
inline void prefetch_partners(const SchurRow& in, int a) {
  if (a >= in.end) return;
  const int end = in.graph.point_begin[in.graph.point[a] + 1];
  for (int position = in.graph.rank[a] + 1; position < end; ++position) {
    const double* coupling = in.coupling + 3L * D * in.graph.of_point[position];
    for (int k = 0; k < 3 * D; k += 8) __builtin_prefetch(coupling + k);
  }
}

template <int D>
void schur_row(const SchurRow& in) {
  constexpr int kAhead = 4;
  const GraphView& graph = in.graph;
  const long first = in.begin;
  diagonal_and_rhs<D>(
      in.end - first, in.jacobian + first * 2 * D, graph.point + first, in.factors,
      [&](long a) { return in.coupling + (first + a) * 3 * D; }, in.diagonal, in.rhs);
  for (int a = in.begin; a < in.end; ++a) {
    prefetch_partners<D>(in, a + kAhead);
    Row<D> rows[3];
    const Row<D>* pointers[3];
    for (int k = 0; k < 3; ++k) {
      load_row(in.coupling + (3L * a + k) * D, rows[k], -1.0);
      pointers[k] = &rows[k];
    }
    const int end = graph.point_begin[graph.point[a] + 1];
    for (int position = graph.rank[a] + 1; position < end; ++position) {
      const long b = graph.of_point[position];
      const long block = in.block_of_camera[graph.camera[b]];
      rank_update<D, 3>(pointers, in.coupling + b * 3 * D, in.blocks + block * D * D);
    }
  }
}

template <int D, int kFirst = 0>
inline double dot(const Row<D, kFirst>& a, const Row<D, kFirst>& b) {
  if constexpr (kFirst < D) {
    return sum_of_lanes(a.head * b.head) + dot(a.tail, b.tail);
  } else {
    return 0.0;
  }
}

template <int D>
void coupled_sums(const GraphView& graph, int begin, int end, const double* coupling, const double* steps,
                  double* sums) {
  constexpr int kAhead = 8;
  const int last = graph.point_begin[end];
  for (int p = begin; p < end; ++p) {
    double sum[3] = {0.0, 0.0, 0.0};
    for (int position = graph.point_begin[p]; position < graph.point_begin[p + 1]; ++position) {
      if (position + kAhead < last) {
        const double* ahead = coupling + 3L * D * graph.of_point[position + kAhead];
        for (int k = 0; k < 3 * D; k += 8) __builtin_prefetch(ahead + k);
      }
      const long b = graph.of_point[position];
      Row<D> step;
      load_row(steps + static_cast<long>(D) * graph.camera[b], step);
      for (int k = 0; k < 3; ++k) {
        Row<D> row;
        load_row(coupling + (3 * b + k) * D, row);
        sum[k] += dot(row, step);
      }
    }
    for (int k = 0; k < 3; ++k) sums[3 * (p - begin) + k] = sum[k];
  }
}

template <int D>
void apply(int n, const double* jacobian, const double* x, double* e) {
  Row<D> step;
  load_row(x, step);
  for (long k = 0; k < 2L * n; ++k) {
    Row<D> row;
    load_row(jacobian + k * D, row);
    e[k] = dot(row, step);
  }
}

template <int D>
void apply_transposed(int n, const double* jacobian, const double* e, double* out) {
  Row<D> sum;
  load_row(out, sum);
  for (long k = 0; k < 2L * n; ++k) {
    Row<D> row;
    load_row(jacobian + k * D, row);
    add_scaled(sum, row, e[k]);
  }
  store_row(out, sum);
}

template <int D>
SchurKernels kernels() {
  return {.camera_gradient = &camera_gradient<D>,
          .couple = &couple<D>,
          .schur_row = &schur_row<D>,
          .coupled_sums = &coupled_sums<D>,
          .whiten = &whiten,
          .schur_diagonal = &schur_diagonal<D>,
          .apply = &apply<D>,
          .apply_transposed = &apply_transposed<D>};
}

}  // namespace

SchurKernels kernels_for(int camera_size) {
  switch (camera_size) {
    case 6:
      return kernels<6>();
    case 9:
      return kernels<9>();
    case 12:
      return kernels<12>();
    default:
      return kernels<18>();
  }
}

}  // namespace sfmcpp::linear::SFMCPP_ISA

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

// block += factor · aᵀ b with a and b of kRank rows each.
template <int D, int kRank>
inline void add_product(const double* a, const double* b, double factor, double* block) {
  Row<D> rows[kRank];
  const Row<D>* pointers[kRank];
  for (int k = 0; k < kRank; ++k) {
    load_row(a + k * D, rows[k], factor);
    pointers[k] = &rows[k];
  }
  rank_update<D, kRank>(pointers, b, block);
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

void eliminate(int n, const double* records, const int* point, const double* factors, double* eliminated) {
  for (int a = 0; a < n; ++a) {
    const double* m = factors + static_cast<long>(kPointFactor) * point[a];
    const double* y = m + 6;
    for (int row = 0; row < 2; ++row) {
      const double* in = records + kPointRecord * static_cast<long>(a) + 4 * row;
      double* g = eliminated + kPointRecord * static_cast<long>(a) + 4 * row;
      g[0] = in[0] * m[0];
      g[1] = in[0] * m[1] + in[1] * m[2];
      g[2] = in[0] * m[3] + in[1] * m[4] + in[2] * m[5];
      g[3] = in[3] - (g[0] * y[0] + g[1] * y[1] + g[2] * y[2]);
    }
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
    add_scaled(p, j1, g[4 + k]);
    store_row(coupling + k * D, p);
  }
}

template <int D>
void couple(int n, const double* jacobian, const double* eliminated, double* coupling) {
  for (long a = 0; a < n; ++a) {
    couple_one<D>(jacobian + a * 2 * D, eliminated + a * kPointRecord, coupling + a * 3 * D);
  }
}

// diagonal = Σ Jᵀ J − Pᵀ P and rhs = Σ Jᵀ r̄, with P given by p(a).
template <int D, class Coupling>
inline void diagonal_and_rhs(long begin, long end, const double* jacobian, const double* eliminated,
                             const Coupling& p, double* diagonal, double* rhs) {
  for (int k = 0; k < D * D; ++k) diagonal[k] = 0.0;
  Row<D> sum;
  set_zero(sum);
  for (long a = begin; a < end; ++a) {
    const double* j = jacobian + a * 2 * D;
    const double* coupling = p(a);
    add_product<D, 2>(j, j, 1.0, diagonal);
    add_product<D, 3>(coupling, coupling, -1.0, diagonal);
    for (int row = 0; row < 2; ++row) {
      Row<D> r;
      load_row(j + row * D, r);
      add_scaled(sum, r, eliminated[a * kPointRecord + 4 * row + 3]);
    }
  }
  store_row(rhs, sum);
}

template <int D>
void schur_diagonal(int n, const double* jacobian, const double* eliminated, double* diagonal, double* rhs) {
  double buffer[3 * D];
  const auto coupling = [&](long a) {
    couple_one<D>(jacobian + a * 2 * D, eliminated + a * kPointRecord, buffer);
    return static_cast<const double*>(buffer);
  };
  diagonal_and_rhs<D>(0, n, jacobian, eliminated, coupling, diagonal, rhs);
}

template <int D>
void schur_row(const SchurRow& in) {
  diagonal_and_rhs<D>(
      in.begin, in.end, in.jacobian, in.eliminated, [&](long a) { return in.coupling + a * 3 * D; },
      in.diagonal, in.rhs);
  for (int a = in.begin; a < in.end; ++a) {
    Row<D> rows[3];
    const Row<D>* pointers[3];
    for (int k = 0; k < 3; ++k) {
      load_row(in.coupling + (3L * a + k) * D, rows[k], -1.0);
      pointers[k] = &rows[k];
    }
    const int end = in.point_begin[in.point[a] + 1];
    for (int position = in.rank[a] + 1; position < end; ++position) {
      const long b = in.of_point[position];
      const long block = in.block_of_camera[in.camera[b]];
      rank_update<D, 3>(pointers, in.coupling + b * 3 * D, in.blocks + block * D * D);
    }
  }
}

template <int D>
void apply(int n, const double* jacobian, const double* x, double* e) {
  for (long k = 0; k < 2L * n; ++k) {
    double sum = 0.0;
    for (int c = 0; c < D; ++c) sum += jacobian[k * D + c] * x[c];
    e[k] = sum;
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
  return {&camera_gradient<D>, &eliminate, &couple<D>, &schur_row<D>, &schur_diagonal<D>, &apply<D>,
          &apply_transposed<D>};
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

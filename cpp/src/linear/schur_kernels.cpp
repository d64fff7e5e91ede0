// Compiled once per instruction set; see core/isa.hpp for what may be used here.
#include "register_blocks.hpp"
#include "sfmcpp/linear/schur_isa.hpp"

namespace sfmcpp::linear::SFMCPP_ISA {
namespace {

template <int D>
void camera_gradient(
    int n, const double* jacobian, const double* records, double* gradient, double* diagonal) {
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

void eliminate(
    int n, const double* records, const int* point, const double* factors, double* eliminated) {
  for (long a = 0; a < n; ++a) {
    const double* m = factors + static_cast<long>(kPointFactor) * point[a];
    const double* y = m + 6;
    for (int row = 0; row < 2; ++row) {
      const double* in = records + kPointRecord * a + 4 * row;
      double* g = eliminated + kPointRecord * a + 4 * row;
      g[0] = in[0] * m[0];
      g[1] = in[0] * m[1] + in[1] * m[2];
      g[2] = in[0] * m[3] + in[1] * m[4] + in[2] * m[5];
      g[3] = in[3] - (g[0] * y[0] + g[1] * y[1] + g[2] * y[2]);
    }
  }
}

inline double dot3(const double* a, const double* b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// J of one observation in registers.
template <int D>
struct Rows {
  Row<D> first, second;

  explicit Rows(const double* jacobian) {
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

// diagonal = Σ Jᵀ (I − G Gᵀ) J and rhs = Σ Jᵀ r̄.
template <int D>
void schur_diagonal(
    int n, const double* jacobian, const double* eliminated, double* diagonal, double* rhs) {
  Block<D> block;
  set_zero(block);
  Row<D> sum;
  set_zero(sum);
  for (long a = 0; a < n; ++a) {
    const double* j = jacobian + a * 2 * D;
    const double* g = eliminated + a * kPointRecord;
    const Rows<D> rows(j);
    const double cross = -dot3(g, g + 4);
    Row<D> weighted;
    rows.combine(1.0 - dot3(g, g), cross, weighted);
    add_outer(block, weighted, j);
    rows.combine(cross, 1.0 - dot3(g + 4, g + 4), weighted);
    add_outer(block, weighted, j + D);
    add_scaled(sum, rows.first, g[3]);
    add_scaled(sum, rows.second, g[7]);
  }
  store_block(block, diagonal);
  store_row(rhs, sum);
}

// Asks for what the observations that share the point of observation a hold. It lies anywhere in
// memory, and waiting for it took longer than the arithmetic.
template <int D>
inline void prefetch_partners(const SchurRow& in, int a) {
  if (a >= in.end) return;
  const int end = in.graph.point_begin[in.graph.point[a] + 1];
  for (int position = in.graph.rank[a] + 1; position < end; ++position) {
    const long b = in.graph.of_point[position];
    const double* jacobian = in.jacobian + 2 * D * b;
    for (int k = 0; k < 2 * D; k += 8) __builtin_prefetch(jacobian + k);
    __builtin_prefetch(in.eliminated + kPointRecord * b);
  }
}

// block −= J_aᵀ (G_a G_bᵀ) J_b.
template <int D>
inline void subtract_pair(
    const Rows<D>& rows, const double* ga, const double* jb, const double* gb, double* block) {
  Row<D> weighted[2];
  rows.combine(-dot3(ga, gb), -dot3(ga + 4, gb), weighted[0]);
  rows.combine(-dot3(ga, gb + 4), -dot3(ga + 4, gb + 4), weighted[1]);
  const Row<D>* pointers[2] = {&weighted[0], &weighted[1]};
  rank_update<D, 2>(pointers, jb, block);
}

template <int D>
void schur_row(const SchurRow& in) {
  constexpr int kAhead = 4;
  const GraphView& graph = in.graph;
  const long first = in.begin;
  schur_diagonal<D>(in.end - in.begin,
                    in.jacobian + first * 2 * D,
                    in.eliminated + first * kPointRecord,
                    in.diagonal,
                    in.rhs);
  for (int a = in.begin; a < in.end; ++a) {
    prefetch_partners<D>(in, a + kAhead);
    const Rows<D> rows(in.jacobian + 2L * D * a);
    const double* ga = in.eliminated + static_cast<long>(kPointRecord) * a;
    const int end = graph.point_begin[graph.point[a] + 1];
    for (int position = graph.rank[a] + 1; position < end; ++position) {
      const long b = graph.of_point[position];
      const long block = in.block_of_camera[graph.camera[b]];
      subtract_pair<D>(rows,
                       ga,
                       in.jacobian + b * 2 * D,
                       in.eliminated + b * kPointRecord,
                       in.blocks + block * D * D);
    }
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
          .eliminate = &eliminate,
          .schur_row = &schur_row<D>,
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

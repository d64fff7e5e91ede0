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

void whiten(
    int n, const double* records, const int* point, const double* factors, double* whitened) {
  for (long a = 0; a < n; ++a) {
    whiten_one(records + kPointRecord * a,
               factors + static_cast<long>(kPointFactor) * point[a],
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
void couple(int n,
            const double* records,
            const int* point,
            const double* factors,
            const double* jacobian,
            double* coupling) {
  for (long a = 0; a < n; ++a) {
    double g[kWhitenedPoint];
    whiten_one(records + kPointRecord * a, factors + static_cast<long>(kPointFactor) * point[a], g);
    couple_one<D>(jacobian + a * 2 * D, g, coupling + a * 3 * D);
  }
}

// block = Σ Jᵀ J − Pᵀ P and rhs = −Σ Pᵀ y over n observations, with P given by p(a).
template <int D, class Coupling>
inline void diagonal_and_rhs(long n,
                             const double* jacobian,
                             const int* point,
                             const double* factors,
                             const Coupling& p,
                             double* diagonal,
                             double* rhs) {
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
void schur_diagonal(int n,
                    const double* jacobian,
                    const double* whitened,
                    const int* point,
                    const double* factors,
                    double* diagonal,
                    double* rhs) {
  double buffer[3 * D];
  const auto coupling = [&](long a) {
    couple_one<D>(jacobian + a * 2 * D, whitened + a * kWhitenedPoint, buffer);
    return static_cast<const double*>(buffer);
  };
  diagonal_and_rhs<D>(n, jacobian, point, factors, coupling, diagonal, rhs);
}

// Asks for the coupling blocks that observation a will meet. They lie anywhere in memory, and
// waiting for them took longer than the arithmetic.
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
      in.end - first,
      in.jacobian + first * 2 * D,
      graph.point + first,
      in.factors,
      [&](long a) { return in.coupling + (first + a) * 3 * D; },
      in.diagonal,
      in.rhs);
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

template <int D>
void coupled_sums(const GraphView& graph,
                  int begin,
                  int end,
                  const double* coupling,
                  const double* steps,
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

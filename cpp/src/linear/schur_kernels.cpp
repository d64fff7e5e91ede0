// Compiled once per instruction set; see core/isa.hpp for what may be used here.
#include "sfmcpp/linear/schur_kernels.hpp"

#include "pair_sums.hpp"

namespace sfmcpp::linear::SFMCPP_ISA {
namespace {

template <int D>
void camera_gradient(int n, const double* jacobian, const PointRecord* records, double* sums) {
  Row<D> sum, squares;
  load_row(sums, sum);
  load_row(sums + D, squares);
  for (int a = 0; a < n; ++a) {
    for (int row = 0; row < 2; ++row) {
      Row<D> j;
      load_row(jacobian + (2L * a + row) * D, j);
      add_scaled(sum, j, records[a].row[row].residual);
      add_squares(squares, j);
    }
  }
  store_row(sums, sum);
  store_row(sums + D, squares);
}

template <int D>
void compensated_gradient(int n, const double* jacobian, const PointRecord* records, double* sums) {
  Row<D> sum, squares, rest_of_sum, rest_of_squares;
  load_row(sums, sum);
  load_row(sums + D, squares);
  load_row(sums + 2 * D, rest_of_sum);
  load_row(sums + 3 * D, rest_of_squares);
  for (int a = 0; a < n; ++a) {
    for (int row = 0; row < 2; ++row) {
      Row<D> j, square;
      load_row(jacobian + (2L * a + row) * D, j);
      set_zero(square);
      add_squares(square, j);
      add_compensated_scaled(sum, rest_of_sum, j, records[a].row[row].residual);
      add_compensated(squares, rest_of_squares, square);
    }
  }
  store_row(sums, sum);
  store_row(sums + D, squares);
  store_row(sums + 2 * D, rest_of_sum);
  store_row(sums + 3 * D, rest_of_squares);
}

template <int D, class T>
void round_jacobian(int n, const double* jacobian, void* stored) {
  T* out = static_cast<T*>(stored);
  for (long a = 0; a < n; ++a) {
    Row<2 * D> row;
    load_row(jacobian + a * 2 * D, row);
    store_row(out + a * 2 * D, row);
  }
}

// Aᵀ r in the first three lanes.
template <class T>
inline Pack<4> pull(const PointRecordOf<T>& record) {
  const auto& [first, second] = record.row;
  return load<4>(first.by_point) * first.residual + load<4>(second.by_point) * second.residual;
}

template <class T>
void round_records(int n, const PointRecord* records, void* stored, float* lost) {
  auto* out = static_cast<PointRecordOf<T>*>(stored);
  for (long a = 0; a < n; ++a) {
    store(out[a].row[0].by_point, load<8>(records[a].row[0].by_point));
    store(lost + 4 * a, pull(records[a]) - pull(out[a]));
  }
}

// diagonal = Σ Jᵀ (I − G Gᵀ) J and rhs = Σ Jᵀ r̄; where r is rounded, Σ Jᵀ r is given.
template <int D, class T, bool kOnGrid>
void sum_diagonal(const DiagonalSum& in) {
  const Stored<D, T> stored(in.jacobian);
  Block<D> block;
  set_zero(block);
  Row<D> sum, rest, middles;
  set_zero(sum);
  set_zero(rest);
  if constexpr (kOnGrid) middles = middles_of<D>(in.grid);
  const bool rounded = in.gradient != nullptr;
  if (rounded) load_row(in.gradient, sum);
  if (rounded && in.compensated_gradient) load_row(in.gradient + D, rest);
  const auto add_to_rhs = [&](const Row<D>& row, double s) {
    if constexpr (kOnGrid) {
      add_compensated_scaled(sum, rest, row, s);
    } else {
      add_scaled(sum, row, s);
    }
  };
  for (long a = in.begin; a < in.end; ++a) {
    prefetch_factor(in.factors, in.point, a + kFactorsAhead, in.end);
    const Widened<D, T> j(stored.j(a));
    const PointRecordOf<T>& record = stored.record(a);
    const PointFactor& m = in.factors[in.point[a]];
    double g[6];
    whiten(record, m, g);
    const Rows<D> rows(j.numbers);
    const double cross = -dot3(g, g + 3);
    Row<D> weighted[2];
    rows.combine(1.0 - dot3(g, g), cross, weighted[0]);
    rows.combine(cross, 1.0 - dot3(g + 3, g + 3), weighted[1]);
    if constexpr (kOnGrid) {
      add_outer_on_grid(block, weighted, j.numbers, middles, in.grid);
    } else {
      add_outer(block, weighted[0], j.numbers);
      add_outer(block, weighted[1], j.numbers + D);
    }
    const double u = rounded ? 0.0 : record.row[0].residual;
    const double v = rounded ? 0.0 : record.row[1].residual;
    add_to_rhs(rows.first, u - dot3(g, m.y));
    add_to_rhs(rows.second, v - dot3(g + 3, m.y));
  }
  if constexpr (kOnGrid) store_row(in.rhs + D, rest);
  store_block(block, in.diagonal);
  store_row(in.rhs, sum);
}

template <int D, class T>
void schur_diagonal(const DiagonalSum& in) {
  in.grid == nullptr ? sum_diagonal<D, T, false>(in) : sum_diagonal<D, T, true>(in);
}

// Prefetches the observations that share the point of observation a. They lie anywhere in memory,
// and waiting for them took longer than the arithmetic.
template <int D, class T>
SFMCPP_INLINE void prefetch_partners(const SchurRow& in, const Stored<D, T>& stored, int a) {
  if (a >= in.end) return;
  const int end = in.graph.point_begin[in.graph.point[a] + 1];
  for (int position = in.graph.rank[a] + 1; position < end; ++position) {
    stored.prefetch(in.graph.of_point[position]);
  }
}

// block −= J_aᵀ (t_a A_bᵀ) J_b.
template <int D, class T>
inline void subtract_pair(
    const Rows<D>& rows, const double* t, const T* jb, const PointRecordOf<T>& b, double* block) {
  Row<D> weighted[2];
  for (int row = 0; row < 2; ++row) {
    const T* a_b = b.row[row].by_point;
    rows.combine(-dot3(t, a_b), -dot3(t + 3, a_b), weighted[row]);
  }
  const Row<D>* pointers[2] = {&weighted[0], &weighted[1]};
  rank_update<D, 2>(pointers, Widened<D, T>(jb).numbers, block);
}

template <int D, class T>
void schur_row(const SchurRow& in) {
  constexpr int kAhead = 4;
  const GraphView& graph = in.graph;
  const Stored<D, T> stored(in.jacobian);
  for (int a = in.begin; a < in.end; ++a) {
    prefetch_partners(in, stored, a + kAhead);
    const PointFactor& m = in.factors[graph.point[a]];
    const Rows<D> rows(stored.j(a));
    double g[6], t[6];
    whiten(stored.record(a), m, g);
    unwhiten(g, m, t);
    const int end = graph.point_begin[graph.point[a] + 1];
    for (int position = graph.rank[a] + 1; position < end; ++position) {
      const long b = graph.of_point[position];
      const long block = in.block_of_camera[graph.camera[b]];
      subtract_pair<D, T>(rows, t, stored.j(b), stored.record(b), in.blocks + block * D * D);
    }
  }
}

// Σ Gᵀ J x = M Σ Aᵀ J x.
template <int D, class T>
void point_sums(const GraphView& graph,
                int begin,
                int end,
                const StoredJacobian& jacobian,
                const PointFactor* factors,
                const double* steps,
                double* sums) {
  constexpr int kAhead = 8;
  const Stored<D, T> stored(jacobian);
  const int last = graph.point_begin[end];
  for (int p = begin; p < end; ++p) {
    Row<D> by_lane[3];  // of Σ Aᵀ J x
    for (Row<D>& sum : by_lane) set_zero(sum);
    for (int position = graph.point_begin[p]; position < graph.point_begin[p + 1]; ++position) {
      if (position + kAhead < last) {
        const long ahead = graph.of_point[position + kAhead];
        stored.prefetch(ahead);
        __builtin_prefetch(graph.camera + ahead);
      }
      const long b = graph.of_point[position];
      Rows<D> rows(stored.j(b));
      Row<D> step;
      load_row(steps + static_cast<long>(D) * graph.camera[b], step);
      multiply(rows.first, step);
      multiply(rows.second, step);
      const auto& a = stored.record(b).row;
      for (int k = 0; k < 3; ++k) {
        add_scaled(by_lane[k], rows.first, a[0].by_point[k]);
        add_scaled(by_lane[k], rows.second, a[1].by_point[k]);
      }
    }
    double s[3];
    for (int k = 0; k < 3; ++k) s[k] = sum_of_row(by_lane[k]);
    const PointFactor& m = factors[p];
    double* sum = sums + 3L * (p - begin);
    sum[0] = m.m00 * s[0];
    sum[1] = m.m10 * s[0] + m.m11 * s[1];
    sum[2] = m.m20 * s[0] + m.m21 * s[1] + m.m22 * s[2];
  }
}

template <int D, class T>
void schur_product(const StoredJacobian& jacobian,
                   int begin,
                   int end,
                   const int* point,
                   const double* shifts,
                   const double* x,
                   double* out) {
  const Stored<D, T> stored(jacobian);
  Row<D> step, sum, rest;
  load_row(x, step);
  load_row(out, sum);
  load_row(out + D, rest);
  for (long a = begin; a < end; ++a) {
    const Rows<D> rows(stored.j(a));
    const auto& row = stored.record(a).row;
    const double* t = shifts + 3L * point[a];
    const double u = dot(rows.first, step) - dot3(t, row[0].by_point);
    const double v = dot(rows.second, step) - dot3(t, row[1].by_point);
    add_compensated_scaled(sum, rest, rows.first, u);
    add_compensated_scaled(sum, rest, rows.second, v);
  }
  store_row(out, sum);
  store_row(out + D, rest);
}

template <int D, class T>
void curvature(const StoredJacobian& jacobian,
               int begin,
               int end,
               const int* point,
               const double* shifts,
               const double* x,
               CompensatedSum& sum) {
  const Stored<D, T> stored(jacobian);
  Row<D> step;
  load_row(x, step);
  for (long a = begin; a < end; ++a) {
    const Rows<D> rows(stored.j(a));
    const auto& row = stored.record(a).row;
    const double* t = shifts + 3L * point[a];
    const double u = dot(rows.first, step) + dot3(t, row[0].by_point);
    const double v = dot(rows.second, step) + dot3(t, row[1].by_point);
    sfmcpp::add_compensated(sum.sum, sum.rest, u * u + v * v);
  }
}

template <class T>
void point_gradients(const GraphView& graph,
                     int begin,
                     int end,
                     const StoredJacobian& jacobian,
                     const double* residuals,
                     double* gradients) {
  constexpr int kAhead = 12;
  const auto* records = static_cast<const PointRecordOf<T>*>(jacobian.records);
  const int last = graph.point_begin[end];
  for (int p = begin; p < end; ++p) {
    double g[3] = {0.0, 0.0, 0.0};
    for (int position = graph.point_begin[p]; position < graph.point_begin[p + 1]; ++position) {
      if (position + kAhead < last) {
        const long ahead = graph.of_point[position + kAhead];
        __builtin_prefetch(records + ahead);
        __builtin_prefetch(residuals + 2 * ahead);
      }
      const long a = graph.of_point[position];
      const auto& row = records[a].row;
      for (int k = 0; k < 3; ++k) {
        g[k] += row[0].by_point[k] * residuals[2 * a] + row[1].by_point[k] * residuals[2 * a + 1];
      }
    }
    for (int k = 0; k < 3; ++k) gradients[3L * (p - begin) + k] = g[k];
  }
}

template <int D, class T>
void reduced_gradient(const StoredJacobian& jacobian,
                      int begin,
                      int end,
                      const int* point,
                      const double* shifts,
                      const double* residuals,
                      double* out) {
  const Stored<D, T> stored(jacobian);
  Row<D> sum;
  load_row(out, sum);
  for (long a = begin; a < end; ++a) {
    const Rows<D> rows(stored.j(a));
    const auto& row = stored.record(a).row;
    const double* t = shifts + 3L * point[a];
    add_scaled(sum, rows.first, residuals[2 * a] - dot3(t, row[0].by_point));
    add_scaled(sum, rows.second, residuals[2 * a + 1] - dot3(t, row[1].by_point));
  }
  store_row(out, sum);
}

template <int D, class T>
constexpr auto sum_of_pairs() -> void (*)(const PairSums&) {
  if constexpr (kSumsPairs<D>) {
    return &sum_pairs<D, T>;
  } else {
    return nullptr;
  }
}

template <int D, class T>
SchurKernels kernels() {
  return {.camera_gradient = &camera_gradient<D>,
          .compensated_gradient = &compensated_gradient<D>,
          .schur_row = &schur_row<D, T>,
          .sum_pairs = sum_of_pairs<D, T>(),
          .round_jacobian = &round_jacobian<D, T>,
          .round_records = &round_records<T>,
          .schur_diagonal = &schur_diagonal<D, T>,
          .point_sums = &point_sums<D, T>,
          .schur_product = &schur_product<D, T>,
          .curvature = &curvature<D, T>,
          .point_gradients = &point_gradients<T>,
          .reduced_gradient = &reduced_gradient<D, T>};
}

template <class T>
SchurKernels kernels(int camera_size) {
  switch (camera_size) {
    case 6:
      return kernels<6, T>();
    case 9:
      return kernels<9, T>();
    case 12:
      return kernels<12, T>();
    default:
      return kernels<18, T>();
  }
}

}  // namespace

SchurKernels kernels_for(int camera_size, Precision stored) {
  return stored == Precision::kSingle ? kernels<float>(camera_size) : kernels<double>(camera_size);
}

}  // namespace sfmcpp::linear::SFMCPP_ISA

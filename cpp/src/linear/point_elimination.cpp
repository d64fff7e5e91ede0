#include "sfmcpp/linear/point_elimination.hpp"

#include <algorithm>
#include <cmath>

namespace sfmcpp::linear {
namespace {

// Pivots below this share of their diagonal entry carry no information: the point stays where it is
// along that direction.
constexpr double kPivotTolerance = 1e-13;

double inverse_root(double pivot, double diagonal) {
  return pivot > kPivotTolerance * diagonal && pivot > 0.0 ? 1.0 / std::sqrt(pivot) : 0.0;
}

}  // namespace

PointFactor factor_of(const PointBlock& v, const Damping& damping) {
  const double* b = v.rhs;
  const double d0 = v.v00 + damping(v.v00);
  const double d1 = v.v11 + damping(v.v11);
  const double d2 = v.v22 + damping(v.v22);
  // L row by row, with reciprocal pivots; then M = L⁻¹ by forward substitution.
  const double m00 = inverse_root(d0, d0);
  const double l10 = v.v10 * m00, l20 = v.v20 * m00;
  const double m11 = inverse_root(d1 - l10 * l10, d1);
  const double l21 = (v.v21 - l20 * l10) * m11;
  const double m22 = inverse_root(d2 - l20 * l20 - l21 * l21, d2);
  const double m10 = -l10 * m00 * m11;
  const double m21 = -l21 * m11 * m22;
  const double m20 = -(l20 * m00 + l21 * m10) * m22;
  return {m00,
          m10,
          m11,
          m20,
          m21,
          m22,
          {m00 * b[0], m10 * b[0] + m11 * b[1], m20 * b[0] + m21 * b[1] + m22 * b[2]}};
}

PointElimination::PointElimination(const NormalEquations& normal) : normal_(normal) {
  const ObservationGraph& graph = normal.graph();
  factors_.resize(static_cast<std::size_t>(graph.num_points));
  steps_.resize(static_cast<std::size_t>(graph.num_cameras) * normal.map().camera_size);
  sums_.resize(3 * static_cast<std::size_t>(graph.num_points));
}

void PointElimination::factor(const Damping& damping) {
  for_each_point(normal_.pool(), normal_.graph().num_points, [&](int p) {
    factors_[p] =
        normal_.map().free_point[p] ? factor_of(normal_.point_block(p), damping) : PointFactor{};
  });
}

const double* PointElimination::expanded(int i) const {
  return steps_.data() + static_cast<long>(normal_.map().camera_size) * i;
}

const double* PointElimination::point_sums(const std::vector<double>& x) {
  const ObservationGraph& graph = normal_.graph();
  const ParameterMap& map = normal_.map();
  normal_.pool().parallel_for_parts(graph.num_cameras, kCamerasPerTask, [&](long begin, long end) {
    for (long i = begin; i < end; ++i)
      map.expand(x.data(), static_cast<int>(i), steps_.data() + map.camera_size * i);
  });
  normal_.pool().parallel_for(num_point_tasks(graph.num_points), [&](int task) {
    const int begin = task * kPointsPerTask;
    const int end = std::min(begin + kPointsPerTask, graph.num_points);
    normal_.kernels().point_sums(graph.view(),
                                 begin,
                                 end,
                                 normal_.jacobian(),
                                 factors_.data(),
                                 steps_.data(),
                                 sums_.data() + 3L * begin);
  });
  return sums_.data();
}

void PointElimination::solve(const std::vector<double>& g, std::vector<double>& x) const {
  x.resize(g.size());
  for_each_point(normal_.pool(), normal_.graph().num_points, [&](int p) {
    solve_point(factor(p), g.data() + 3L * p, x.data() + 3L * p);
  });
}

void PointElimination::back_substitute(Step& step) {
  const double* sums = point_sums(step.camera);
  step.point.resize(sums_.size());
  for_each_point(normal_.pool(), normal_.graph().num_points, [&](int p) {
    const PointFactor& m = factor(p);
    const double* sum = sums + 3L * p;
    const double z[3] = {m.y[0] - sum[0], m.y[1] - sum[1], m.y[2] - sum[2]};
    multiply_by_transposed_factor(m, z, step.point.data() + 3L * p);
  });
}

OtherResiduals::OtherResiduals(const NormalEquations& normal, PointElimination& elimination)
    : normal_(normal), elimination_(elimination) {}

void OtherResiduals::solve_points(const std::vector<double>& residuals, Step& step) {
  step.camera.assign(normal_.map().num_columns, 0.0);
  eliminate(residuals, step.point);
}

void OtherResiduals::eliminate(const std::vector<double>& residuals, std::vector<double>& shifts) {
  const ObservationGraph& graph = normal_.graph();
  shifts.resize(3 * static_cast<std::size_t>(graph.num_points));
  normal_.pool().parallel_for(num_point_tasks(graph.num_points), [&](int task) {
    const int begin = task * kPointsPerTask;
    const int end = std::min(begin + kPointsPerTask, graph.num_points);
    double* x = shifts.data() + 3L * begin;
    normal_.kernels().point_gradients(
        graph.view(), begin, end, normal_.jacobian(), residuals.data(), x);
    for (int p = begin; p < end; ++p, x += 3) solve_point(elimination_.factor(p), x, x);
  });
}

void OtherResiduals::reduce(const std::vector<double>& residuals, std::vector<double>& rhs) {
  const ObservationGraph& graph = normal_.graph();
  const long size = normal_.map().camera_size;
  eliminate(residuals, shifts_);
  chunk_sums_.resize(graph.chunks.size() * static_cast<std::size_t>(size));
  normal_.pool().parallel_for(static_cast<int>(graph.chunks.size()), [&](int chunk) {
    const Chunk& c = graph.chunks[chunk];
    double* sum = chunk_sums_.data() + size * chunk;
    std::fill_n(sum, size, 0.0);
    normal_.kernels().reduced_gradient(normal_.jacobian(),
                                       c.begin,
                                       c.end,
                                       graph.point.data(),
                                       shifts_.data(),
                                       residuals.data(),
                                       sum);
  });
  rhs.assign(normal_.map().num_columns, 0.0);
  normal_.fold_chunks(chunk_sums_.data(), size, rhs.data());
  normal_.exchange().sum(rhs);
}

void OtherResiduals::back_substitute(Step& step) {
  const double* sums = elimination_.point_sums(step.camera);
  step.point.resize(shifts_.size());
  for_each_point(normal_.pool(), normal_.graph().num_points, [&](int p) {
    double* delta = step.point.data() + 3L * p;
    multiply_by_transposed_factor(elimination_.factor(p), sums + 3L * p, delta);
    for (int k = 0; k < 3; ++k) delta[k] = shifts_[3L * p + k] - delta[k];
  });
}

}  // namespace sfmcpp::linear

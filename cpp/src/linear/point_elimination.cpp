#include "sfmcpp/linear/point_elimination.hpp"

#include <algorithm>
#include <array>
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

PointElimination::PointElimination(const NormalEquations& normal) : normal_(normal) {
  const ObservationGraph& graph = normal.graph();
  factors_.resize(static_cast<std::size_t>(graph.num_points) * kPointFactor);
  steps_.resize(static_cast<std::size_t>(graph.num_cameras) * normal.map().camera_size);
  sums_.resize(3 * static_cast<std::size_t>(graph.num_points));
}

void PointElimination::factor(const Damping& damping) {
  for_each_point(
      normal_.pool(), normal_.graph().num_points, [&](int p) { factor_point(p, damping); });
}

void PointElimination::factor_point(int p, const Damping& damping) {
  const double* v = normal_.point_block(p);
  double* m = factors_.data() + static_cast<long>(kPointFactor) * p;
  if (!normal_.map().free_point[p]) {
    std::fill_n(m, kPointFactor, 0.0);
    return;
  }
  const double d0 = v[0] + damping(v[0]), d1 = v[2] + damping(v[2]), d2 = v[5] + damping(v[5]);
  // L row by row, with reciprocal pivots; then M = L⁻¹ by forward substitution.
  const double m00 = inverse_root(d0, d0);
  const double l10 = v[1] * m00, l20 = v[3] * m00;
  const double m11 = inverse_root(d1 - l10 * l10, d1);
  const double l21 = (v[4] - l20 * l10) * m11;
  const double m22 = inverse_root(d2 - l20 * l20 - l21 * l21, d2);
  const double m10 = -l10 * m00 * m11;
  const double m21 = -l21 * m11 * m22;
  const double m20 = -(l20 * m00 + l21 * m10) * m22;
  const std::array<double, 6> inverse{m00, m10, m11, m20, m21, m22};
  std::copy(inverse.begin(), inverse.end(), m);
  m[6] = m00 * v[6];
  m[7] = m10 * v[6] + m11 * v[7];
  m[8] = m20 * v[6] + m21 * v[7] + m22 * v[8];
}

const double* PointElimination::expanded(int i) const {
  return steps_.data() + static_cast<long>(normal_.map().camera_size) * i;
}

const double* PointElimination::point_sums(const std::vector<double>& x) {
  const ObservationGraph& graph = normal_.graph();
  const ParameterMap& map = normal_.map();
  for (int i = 0; i < graph.num_cameras; ++i) {
    map.expand(x.data(), i, steps_.data() + static_cast<long>(map.camera_size) * i);
  }
  normal_.pool().parallel_for(num_point_tasks(graph.num_points), [&](int task) {
    const int begin = task * kPointsPerTask;
    const int end = std::min(begin + kPointsPerTask, graph.num_points);
    normal_.kernels().point_sums(graph.view(),
                                 begin,
                                 end,
                                 normal_.jacobian(),
                                 normal_.records(),
                                 factors_.data(),
                                 steps_.data(),
                                 sums_.data() + 3L * begin);
  });
  return sums_.data();
}

void PointElimination::solve(const std::vector<double>& g, std::vector<double>& x) const {
  x.resize(g.size());
  for_each_point(normal_.pool(), normal_.graph().num_points, [&](int p) {
    const double* m = factor(p);
    const double* in = g.data() + 3L * p;
    const double z[3] = {
        m[0] * in[0], m[1] * in[0] + m[2] * in[1], m[3] * in[0] + m[4] * in[1] + m[5] * in[2]};
    multiply_by_transposed_factor(m, z, x.data() + 3L * p);
  });
}

void PointElimination::back_substitute(Step& step) {
  const double* sums = point_sums(step.camera);
  step.point.resize(sums_.size());
  for_each_point(normal_.pool(), normal_.graph().num_points, [&](int p) {
    const double* m = factor(p);
    const double* sum = sums + 3L * p;
    const double z[3] = {m[6] - sum[0], m[7] - sum[1], m[8] - sum[2]};
    multiply_by_transposed_factor(m, z, step.point.data() + 3L * p);
  });
}

}  // namespace sfmcpp::linear

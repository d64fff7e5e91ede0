#include "sfmcpp/linear/point_elimination.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace sfmcpp::linear {
namespace {

// Pivots below this share of their diagonal entry carry no information: the point stays where it is
// along that direction.
constexpr double kPivotTolerance = 1e-13;

// How many observations ahead a record is asked for: those of a point lie anywhere in memory.
constexpr int kAhead = 8;

double inverse_root(double pivot, double diagonal) {
  return pivot > kPivotTolerance * diagonal && pivot > 0.0 ? 1.0 / std::sqrt(pivot) : 0.0;
}

}  // namespace

PointElimination::PointElimination(const NormalEquations& normal) : normal_(normal) {
  const auto observations = static_cast<std::size_t>(normal.graph().num_observations());
  factors_.resize(static_cast<std::size_t>(normal.graph().num_points) * kPointFactor);
  eliminated_.resize(observations * kPointRecord);
  applied_.resize(observations * 2);
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

void PointElimination::eliminate(const Damping& damping) {
  const ObservationGraph& graph = normal_.graph();
  for_each_point(normal_.pool(), graph.num_points, [&](int p) { factor_point(p, damping); });
  normal_.pool().parallel_for(static_cast<int>(graph.chunks.size()), [&](int chunk) {
    const Chunk& c = graph.chunks[chunk];
    const long begin = static_cast<long>(kPointRecord) * c.begin;
    normal_.kernels().eliminate(c.end - c.begin,
                                normal_.records() + begin,
                                graph.point.data() + c.begin,
                                factors_.data(),
                                eliminated_.data() + begin);
  });
}

void PointElimination::apply_cameras(const std::vector<double>& x) {
  const ObservationGraph& graph = normal_.graph();
  const ParameterMap& map = normal_.map();
  normal_.pool().parallel_for(static_cast<int>(graph.chunks.size()), [&](int chunk) {
    const Chunk& c = graph.chunks[chunk];
    std::array<double, kMaxCameraSize> block;
    map.expand(x.data(), c.camera, block.data());
    normal_.kernels().apply(c.end - c.begin,
                            normal_.jacobian() + 2L * map.camera_size * c.begin,
                            block.data(),
                            applied_.data() + 2L * c.begin);
  });
}

void PointElimination::sum_of_point(int p, double* sum) const {
  std::fill_n(sum, 3, 0.0);
  const ObservationGraph& graph = normal_.graph();
  const auto last = static_cast<int>(graph.of_point.size()) - 1;
  for (int k = graph.point_begin[p]; k < graph.point_begin[p + 1]; ++k) {
    const int ahead = graph.of_point[std::min(k + kAhead, last)];
    __builtin_prefetch(eliminated(ahead));
    __builtin_prefetch(applied(ahead));
    const double* g = eliminated(graph.of_point[k]);
    const double* e = applied(graph.of_point[k]);
    for (int c = 0; c < 3; ++c) sum[c] += g[c] * e[0] + g[4 + c] * e[1];
  }
}

void PointElimination::back_substitute(Step& step) {
  apply_cameras(step.camera);
  const int num_points = normal_.graph().num_points;
  step.point.resize(3 * static_cast<std::size_t>(num_points));
  for_each_point(normal_.pool(), num_points, [&](int p) {
    double sum[3];
    sum_of_point(p, sum);
    const double* m = factors_.data() + static_cast<long>(kPointFactor) * p;
    const double z[3] = {m[6] - sum[0], m[7] - sum[1], m[8] - sum[2]};
    double* delta = step.point.data() + 3 * static_cast<std::size_t>(p);
    delta[0] = m[0] * z[0] + m[1] * z[1] + m[3] * z[2];
    delta[1] = m[2] * z[1] + m[4] * z[2];
    delta[2] = m[5] * z[2];
  });
}

}  // namespace sfmcpp::linear

#include "sfmcpp/linear/step_algebra.hpp"

#include <cmath>

#include "sfmcpp/linear/vector_algebra.hpp"

namespace sfmcpp::linear {
namespace {

CompensatedSum dot(ThreadPool& pool, const Vector& a, const Vector& metric, const Vector& b) {
  const auto size = static_cast<long>(a.size());
  return pool.sum_of_parts(size, kNumbersPerTask, [&](long begin, long end) {
    return compensated_sum(begin, end, [&]<int W>(long k) {
      return load<W>(a.data() + k) * load<W>(metric.data() + k) * load<W>(b.data() + k);
    });
  });
}

Vector divide(ThreadPool& pool, const Vector& g, const Vector& metric) {
  Vector result(g.size());
  for_each_part(pool, g, [&](long begin, long end) {
    part(result, begin, end) = part(g, begin, end) / part(metric, begin, end);
  });
  return result;
}

// Three numbers for each point, as value(block, k) gives them.
template <class F>
Vector of_points(const NormalEquations& normal, const F& value) {
  Vector result(3 * static_cast<std::size_t>(normal.graph().num_points));
  for_each_point(normal.pool(), normal.graph().num_points, [&](int p) {
    for (int k = 0; k < 3; ++k) result[3L * p + k] = value(normal.point_block(p), k);
  });
  return result;
}

}  // namespace

double dot(const NormalEquations& normal, const Step& a, const Step& b) {
  return dot(normal.pool(), a.camera, b.camera).value() +
         normal.exchange().sum(dot(normal.pool(), a.point, b.point));
}

double dot(const NormalEquations& normal, const Step& a, const Step& metric, const Step& b) {
  return dot(normal.pool(), a.camera, metric.camera, b.camera).value() +
         normal.exchange().sum(dot(normal.pool(), a.point, metric.point, b.point));
}

double norm(const NormalEquations& normal, const Step& x) { return std::sqrt(dot(normal, x, x)); }

double norm(const NormalEquations& normal, const Step& x, const Step& metric) {
  return std::sqrt(dot(normal, x, metric, x));
}

void scale(const NormalEquations& normal, double s, Step& x) {
  scale(normal.pool(), s, x.camera);
  scale(normal.pool(), s, x.point);
}

void add_scaled(const NormalEquations& normal, double s, const Step& x, Step& y) {
  add_scaled(normal.pool(), s, x.camera, y.camera);
  add_scaled(normal.pool(), s, x.point, y.point);
}

Step divide(const NormalEquations& normal, const Step& g, const Step& metric) {
  return {divide(normal.pool(), g.camera, metric.camera),
          divide(normal.pool(), g.point, metric.point)};
}

Step negative_gradient(const NormalEquations& normal) {
  return {normal.camera_rhs(),
          of_points(normal, [](const PointBlock& block, int k) { return block.rhs[k]; })};
}

double decrease_by_each_alone(const NormalEquations& normal) {
  const Step g = negative_gradient(normal);
  return 0.5 * dot(normal, g, divide(normal, g, damping_entries(normal, DampingMatrix::kDiagonal)));
}

Step damping_entries(const NormalEquations& normal, DampingMatrix matrix) {
  const Damping unit{1.0, matrix};
  return {normal.camera_damping(unit), of_points(normal, [&](const PointBlock& block, int k) {
            return unit(block.diagonal()[k]);
          })};
}

}  // namespace sfmcpp::linear

#include "sfmcpp/linear/step_algebra.hpp"

#include <cmath>
#include <numeric>

namespace sfmcpp::linear {
namespace {

using Vector = std::vector<double>;

double dot(const Vector& a, const Vector& b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

double dot(const Vector& a, const Vector& metric, const Vector& b) {
  double sum = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) sum += a[k] * metric[k] * b[k];
  return sum;
}

void scale(double s, Vector& x) {
  for (double& value : x) value *= s;
}

void add_scaled(double s, const Vector& x, Vector& y) {
  for (std::size_t k = 0; k < y.size(); ++k) y[k] += s * x[k];
}

Vector divide(const Vector& g, const Vector& metric) {
  Vector result(g.size());
  for (std::size_t k = 0; k < g.size(); ++k) result[k] = g[k] / metric[k];
  return result;
}

// Three of the numbers that the normal equations hold for each point.
Vector of_points(const NormalEquations& normal, int first, int second, int third) {
  Vector result;
  result.reserve(3 * static_cast<std::size_t>(normal.graph().num_points));
  for (int p = 0; p < normal.graph().num_points; ++p) {
    const double* block = normal.point_block(p);
    result.insert(result.end(), {block[first], block[second], block[third]});
  }
  return result;
}

}  // namespace

double dot(const Step& a, const Step& b) { return dot(a.camera, b.camera) + dot(a.point, b.point); }

double dot(const Step& a, const Step& metric, const Step& b) {
  return dot(a.camera, metric.camera, b.camera) + dot(a.point, metric.point, b.point);
}

double norm(const Step& x, const Step& metric) { return std::sqrt(dot(x, metric, x)); }

void scale(double s, Step& x) {
  scale(s, x.camera);
  scale(s, x.point);
}

void add_scaled(double s, const Step& x, Step& y) {
  add_scaled(s, x.camera, y.camera);
  add_scaled(s, x.point, y.point);
}

Step divide(const Step& g, const Step& metric) {
  return {divide(g.camera, metric.camera), divide(g.point, metric.point)};
}

Step negative_gradient(const NormalEquations& normal) {
  return {normal.camera_rhs(), of_points(normal, 6, 7, 8)};
}

Step damping_entries(const NormalEquations& normal, DampingMatrix matrix) {
  const Damping unit{1.0, matrix};
  Step entries{normal.camera_damping(unit), of_points(normal, 0, 2, 5)};
  for (double& entry : entries.point) entry = unit(entry);
  return entries;
}

}  // namespace sfmcpp::linear

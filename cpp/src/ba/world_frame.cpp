#include "sfmcpp/ba/world_frame.hpp"

#include <cmath>
#include <vector>

#include "sfmcpp/cameras/camera_model.hpp"
#include "sfmcpp/cameras/matrix34.hpp"
#include "sfmcpp/math/statistics.hpp"

namespace sfmcpp::ba {
namespace {

using Point = Eigen::Map<Eigen::Vector4d>;
using Camera = Eigen::Map<Matrix34>;

// Points nearer to infinity than this have no place worth counting.
constexpr double kInfinite = 1e-9;

// Three numbers for each.
std::vector<double> finite_points(const optim::State& state) {
  std::vector<double> points;
  for (std::size_t k = 0; k < state.points.size(); k += 4) {
    const Eigen::Map<const Eigen::Vector4d> q(state.points.data() + k);
    if (!(std::abs(q[3]) > kInfinite * q.norm())) continue;
    for (int c = 0; c < 3; ++c) points.push_back(q[c] / q[3]);
  }
  return points;
}

template <class F>
double median_over(const std::vector<double>& points, const F& value) {
  std::vector<double> values;
  values.reserve(points.size() / 3);
  for (std::size_t k = 0; k < points.size(); k += 3)
    values.push_back(value(Eigen::Map<const Eigen::Vector3d>(points.data() + k)));
  return median(std::move(values));
}

}  // namespace

WorldFrame::WorldFrame(const optim::State& state, Exchange& exchange) {
  const std::vector<double> points = exchange.gather(finite_points(state));
  if (points.empty()) return;
  Eigen::Vector3d middle;
  for (int k = 0; k < 3; ++k)
    middle[k] = median_over(points, [k](const Eigen::Vector3d& x) { return x[k]; });
  const double radius =
      median_over(points, [&](const Eigen::Vector3d& x) { return (x - middle).norm(); });
  if (!(radius > 0.0)) return;
  const double scale = kRadius / radius;
  to_frame_.diagonal().head<3>().setConstant(scale);
  to_frame_.topRightCorner<3, 1>() = -scale * middle;
  from_frame_.diagonal().head<3>().setConstant(1.0 / scale);
  from_frame_.topRightCorner<3, 1>() = middle;
}

void WorldFrame::transform(optim::State& state,
                           const Eigen::Matrix4d& points,
                           const Eigen::Matrix4d& cameras) {
  for (std::size_t k = 0; k < state.points.size(); k += 4) {
    Point q(state.points.data() + k);
    const double norm = q.norm();
    q = (points * q).eval().normalized() * norm;
  }
  for (std::size_t k = 0; k < state.cameras.size(); k += kCameraStorage) {
    Camera p(state.cameras.data() + k);
    const double norm = p.norm();
    p = (p * cameras).eval().normalized() * norm;
  }
}

}  // namespace sfmcpp::ba

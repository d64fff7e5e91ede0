#include "sfmcpp/ba/point_rescues.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <Eigen/Dense>

#include "sfmcpp/cameras/visit_camera.hpp"

namespace sfmcpp::ba {
namespace {

using Eigen::Vector3d;
using optim::State;

// With half of the views wrong, all pairs of so many miss once in ten thousand points.
constexpr int kMostPairs = 32;
constexpr int kViewsOfAllPairs = 8;
// Of what a view that is let go of costs: to be saved.
constexpr double kLeastGain = 0.1;
// Views that agree on a place, where the point has so many: two rays always nearly meet somewhere.
constexpr int kSupport = 3;
constexpr int kRefits = 3;
constexpr int kPointsPerTask = 16;

struct Ray {
  Vector3d from, along;  // depth grows by one
};

using Pairs = std::vector<std::pair<int, int>>;

// All pairs of few views; of many, some with all distances between them.
Pairs pairs_of(int views) {
  Pairs pairs;
  for (int a = 0; a < views && views <= kViewsOfAllPairs; ++a) {
    for (int b = a + 1; b < views; ++b) pairs.emplace_back(a, b);
  }
  constexpr long kPrime = 7919;
  for (int k = 0; k < kMostPairs && views > kViewsOfAllPairs; ++k) {
    const int a = static_cast<int>(long{k} * views / kMostPairs);
    pairs.emplace_back(a, static_cast<int>((a + 1 + kPrime * k % (views - 1)) % views));
  }
  return pairs;
}

// The middle between two rays where they are closest; none behind a camera, or of parallel ones.
std::optional<Vector3d> meeting_of(const Ray& a, const Ray& b) {
  const Vector3d between = b.from - a.from;
  const double aa = a.along.squaredNorm(), ab = a.along.dot(b.along), bb = b.along.squaredNorm();
  const double ma = a.along.dot(between), mb = b.along.dot(between);
  const double determinant = aa * bb - ab * ab;
  const double depth_a = (ma * bb - mb * ab) / determinant;
  const double depth_b = (ma * ab - mb * aa) / determinant;
  if (!(depth_a > 0.0 && depth_b > 0.0 && std::isfinite(depth_a + depth_b))) return std::nullopt;
  return 0.5 * (a.from + depth_a * a.along + b.from + depth_b * b.along);
}

// One point and its views, as the cameras of a state see it.
template <class Camera>
class Search {
 public:
  Search(const ImageResiduals& images, const State& state, int point)
      : images_(images), state_(state) {
    const linear::ObservationGraph& graph = images.graph();
    views_ = std::span(graph.of_point.data(), graph.of_point.size())
                 .subspan(graph.point_begin[point], graph.observations_of_point(point));
  }

  // Σ ρ at a place; infinite where it is no number, or once it is above `most`.
  double cost(const double* place, double most = kInfinity) const {
    double sum = 0.0;
    for (int view : views_) {
      sum += images_.cost_of_place(state_, view, place);
      if (!(sum <= most)) return kInfinity;
    }
    return sum;
  }

  // A place that costs less than `most`, and on which enough views agree.
  std::optional<Vector3d> best(double most) const {
    std::vector<Ray> rays;
    for (int view : views_) rays.push_back(ray(view));
    std::optional<Vector3d> found;
    for (const auto& [a, b] : pairs_of(static_cast<int>(rays.size()))) {
      const std::optional<Vector3d> place = meeting_of(rays[a], rays[b]);
      if (place && is_supported(*place)) take(*place, most, found);
    }
    for (int k = 0; k < kRefits && found; ++k) {
      if (!take(meeting_near(*found, rays), most, found)) break;
    }
    return found;
  }

 private:
  static constexpr double kInfinity = std::numeric_limits<double>::infinity();

  bool take(const Vector3d& place, double& most, std::optional<Vector3d>& found) const {
    const double there = cost(place.data(), most);
    if (!(there < most)) return false;
    most = there;
    found = place;
    return true;
  }

  bool agrees(int view, const Vector3d& place) const {
    const double scale = images_.loss().scale;
    return images_.cost_of_place(state_, view, place.data()) <= scale * scale;
  }

  bool is_supported(const Vector3d& place) const {
    const auto support =
        std::ranges::count_if(views_, [&](int view) { return agrees(view, place); });
    return support >= std::min(kSupport, static_cast<int>(views_.size()));
  }

  // Where the rays of the views that agree on a place are closest to each other, as seen from them.
  Vector3d meeting_near(const Vector3d& place, const std::vector<Ray>& rays) const {
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    Vector3d rhs = Vector3d::Zero();
    for (std::size_t k = 0; k < rays.size(); ++k) {
      if (!agrees(views_[k], place)) continue;
      const Vector3d along = rays[k].along.normalized();
      const Eigen::Matrix3d across = (Eigen::Matrix3d::Identity() - along * along.transpose()) /
                                     (place - rays[k].from).squaredNorm();
      sum += across;
      rhs += across * rays[k].from;
    }
    return sum.ldlt().solve(rhs);
  }

  Ray ray(int view) const {
    static constexpr std::array<double, 32> kNoChange{};
    const Problem& problem = images_.problem();
    const int camera = images_.graph().camera[view];
    const double* pose = state_.cameras.data() + problem.camera_offset(camera);
    const double* intrinsics = state_.intrinsics.data() + problem.intrinsics_offset(camera);
    double u, v;
    Camera::undistort(intrinsics, images_.u()[view], images_.v()[view], u, v);
    MatrixAndChange projection;
    Camera::matrix(pose, intrinsics, kNoChange.data(), kNoChange.data(), projection);
    const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> matrix(projection.matrix);
    return {{pose[3], pose[7], pose[11]},
            matrix.template leftCols<3>().inverse() * Vector3d(u, v, 1.0)};
  }

  const ImageResiduals& images_;
  const State& state_;
  std::span<const int> views_;
};

}  // namespace

long PointRescues::rescue(State& state) const {
  const double gain = kLeastGain * images_.loss().rho(std::numeric_limits<double>::max());
  const int count = images_.graph().num_points;
  return visit_camera(images_.problem().camera_model, [&](auto camera) {
    using Camera = decltype(camera);
    if constexpr (!Camera::kMetric) return 0L;
    const auto rescued_in = [&](int task) {
      double rescued = 0.0;
      const int end = std::min(count, (task + 1) * kPointsPerTask);
      for (int p = task * kPointsPerTask; p < end; ++p) {
        double* place = state.points.data() + images_.problem().point_offset(p);
        const Search<Camera> search(images_, state, p);
        const double most = search.cost(place) - gain;
        if (!movable_[p] || !(most > 0.0)) continue;
        const std::optional<Vector3d> found = search.best(most);
        if (found) std::copy_n(found->data(), 3, place);
        rescued += found.has_value();
      }
      return rescued;
    };
    const double rescued =
        images_.pool().sum((count + kPointsPerTask - 1) / kPointsPerTask, rescued_in);
    return std::lround(images_.exchange().sum(rescued));
  });
}

}  // namespace sfmcpp::ba

#include "sfmcpp/ba/point_rescues.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "sfmcpp/cameras/visit_camera.hpp"
#include "view_rays.hpp"

namespace sfmcpp::ba {
namespace {

using Eigen::Vector3d;
using optim::State;

// With half of the views wrong a few pairs find some two that are right. Of many there is one that
// meets so near the point that all right views agree.
constexpr int kMostPairs = 120;
constexpr int kViewsOfAllPairs = 16;
// Views that agree on a place, where the point has so many: two rays always nearly meet somewhere.
constexpr int kSupport = 3;
// Views within so many scales of a place draw it, fewer from one time to the next: where the rays
// of two views meet, the others may be off by more than the scale.
constexpr std::array kWidths = {4.0, 2.0, 1.0, 1.0};
constexpr int kPointsPerTask = 16;

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

  // Σ ρ at a place; infinite where it is no number.
  double cost(const Vector3d& place) {
    look_at(place);
    return cost_here();
  }

  // A place that costs less than `most`, and on which enough views agree.
  std::optional<Vector3d> best(const Vector3d& start, double most) {
    for (int view : views_) rays_.push_back(ray_of<Camera>(images_, state_, view));
    most_ = most;
    take_near(start);
    for (const auto& [a, b] : pairs_of(static_cast<int>(rays_.size()))) {
      if (const std::optional<Vector3d> place = meeting_of(rays_[a], rays_[b])) take_near(*place);
    }
    return best_;
  }

 private:
  // The place, and those it comes to as ever fewer views draw it.
  void take_near(Vector3d place) {
    look_at(place);
    for (double width : kWidths) {
      take(place);
      if (!is_supported(width)) return;
      place = meeting_near(place, width);
      look_at(place);
    }
    take(place);
  }

  // Where look_at() looks.
  void take(const Vector3d& place) {
    if (!is_supported(1.0)) return;
    const double cost = cost_here();
    if (!(cost < most_)) return;
    most_ = cost;
    best_ = place;
  }

  void look_at(const Vector3d& place) {
    squares_.clear();
    for (int view : views_) squares_.push_back(images_.square_at_place(state_, view, place.data()));
  }

  double cost_here() const {
    double sum = 0.0;
    for (double square : squares_) sum += images_.rho(square);
    return sum <= std::numeric_limits<double>::max() ? sum
                                                     : std::numeric_limits<double>::infinity();
  }

  bool agrees(double square, double width) const {
    const double reach = width * images_.loss().scale;
    return square <= reach * reach;
  }

  bool is_supported(double width) const {
    const auto support =
        std::ranges::count_if(squares_, [&](double square) { return agrees(square, width); });
    return support >= std::min(kSupport, static_cast<int>(views_.size()));
  }

  // Where the rays of the views that agree on a place, the one looked at, are closest to each
  // other, as seen from them.
  Vector3d meeting_near(const Vector3d& place, double width) const {
    ClosestPlace closest;
    for (std::size_t k = 0; k < rays_.size(); ++k) {
      if (agrees(squares_[k], width))
        closest.add(rays_[k], 1.0 / (place - rays_[k].from).squaredNorm());
    }
    return closest.place();
  }

  const ImageResiduals& images_;
  const State& state_;
  std::span<const int> views_;
  std::vector<Ray> rays_;        // of the views
  std::vector<double> squares_;  // ‖r‖² of the views at the place looked at
  double most_ = 0.0;
  std::optional<Vector3d> best_;
};

}  // namespace

long PointRescues::rescue(State& state) const {
  const double gain = kLeastRescueGain * images_.loss().rho(std::numeric_limits<double>::max());
  const int count = images_.graph().num_points;
  return visit_camera(images_.problem().camera_model, [&](auto camera) {
    using Camera = decltype(camera);
    if constexpr (!Camera::kMetric) return 0L;
    const auto rescued_in = [&](int task) {
      double rescued = 0.0;
      const int end = std::min(count, (task + 1) * kPointsPerTask);
      for (int p = task * kPointsPerTask; p < end; ++p) {
        double* place = state.points.data() + images_.problem().point_offset(p);
        const Vector3d start(place[0], place[1], place[2]);
        Search<Camera> search(images_, state, p);
        const double most = search.cost(start) - gain;
        if (!movable_[p] || !(most > 0.0)) continue;
        const std::optional<Vector3d> found = search.best(start, most);
        if (found) std::copy_n(found->data(), 3, place);
        rescued += found.has_value();
      }
      return rescued;
    };
    const CompensatedSum rescued =
        images_.pool().sum((count + kPointsPerTask - 1) / kPointsPerTask, rescued_in);
    return std::lround(images_.exchange().sum(rescued));
  });
}

}  // namespace sfmcpp::ba

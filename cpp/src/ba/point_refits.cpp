#include "sfmcpp/ba/point_refits.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <span>
#include <vector>

#include "sfmcpp/cameras/camera_model.hpp"
#include "sfmcpp/cameras/visit_camera.hpp"
#include "view_rays.hpp"

namespace sfmcpp::ba {
namespace {

using linear::PointBlock;
using optim::State;
using residuals::kPlaceLanes, residuals::PlaceFits;

// The second order of a point matters from this share of what a point costs in the mean on.
constexpr double kLeastShareOfCost = 1e-4;
constexpr int kMostPasses = 6;
// Points are triangulated that still cost more than so many others with as many observations, and
// fitted from there in so many passes.
constexpr double kPoorFit = 4.0;
constexpr int kTrialPasses = 3;
// Of the normal equations of a point; times the other for each step that has failed.
constexpr double kDamping = 1e-4, kRaised = 100.0;

// A cost that is no number is more than any.
bool costs_less(double cost, double other) {
  return cost < other || (std::isnan(other) && !std::isnan(cost));
}

void copy_lane(const PlaceFits& from, int lane, PlaceFits& to) {
  for (int k = 0; k < 6; ++k) to.v[k][lane] = from.v[k][lane];
  for (int k = 0; k < 3; ++k) to.rhs[k][lane] = from.rhs[k][lane];
  to.cost[lane] = from.cost[lane];
}

// δᵀVδ
double squared_move(const PointBlock& v, const double* d) {
  return v.v00 * d[0] * d[0] + v.v11 * d[1] * d[1] + v.v22 * d[2] * d[2] +
         2.0 * (v.v10 * d[0] * d[1] + v.v20 * d[0] * d[2] + v.v21 * d[1] * d[2]);
}

// (|δ|/z)² of a point with n images.
double squared_turn(const PointBlock& v, const double* d, int images, double focal2) {
  const double length2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
  return length2 * (v.v00 + v.v11 + v.v22) / (2.0 * images * focal2);
}

// The points whose mark is one; few are.
void list_marked(const std::vector<char>& marks, std::vector<int>& points) {
  points.clear();
  const char* begin = marks.data();
  const char* end = begin + marks.size();
  for (const char* at = begin; at != end; ++at) {
    at = static_cast<const char*>(std::memchr(at, 1, static_cast<std::size_t>(end - at)));
    if (at == nullptr) return;
    points.push_back(static_cast<int>(at - begin));
  }
}

void keep_marked(const std::vector<char>& marks, std::vector<int>& points) {
  std::erase_if(points, [&](int p) { return marks[p] == 0; });
}

// Where the rays of point p are closest to each other; as it was in a projective world, whose rays
// have no front. A robust loss allows for wrong observations, and the place would agree with those,
// too: then only for a point behind a camera, which is lost anyway.
void triangulate(const ImageResiduals& images, const State& state, int p, double* place) {
  const linear::ObservationGraph& graph = images.graph();
  visit_camera(images.problem().camera_model, [&](auto camera) {
    using Camera = decltype(camera);
    if constexpr (Camera::kMetric) {
      const Eigen::Vector3d from(place[0], place[1], place[2]);
      ClosestPlace closest;
      bool is_lost = !images.is_robust();
      for (int e = graph.point_begin[p]; e < graph.point_begin[p + 1]; ++e) {
        const Ray ray = ray_of<Camera>(images, state, graph.of_point[e]);
        closest.add(ray, 1.0);
        is_lost |= ray.along.dot(from - ray.from) <= 0.0;
      }
      const Eigen::Vector3d meeting = closest.place();
      if (is_lost) std::copy_n(meeting.data(), 3, place);
    }
  });
}

// Gauss–Newton steps of some points, of each by itself, from where a state has them.
class Pass {
 public:
  Pass(const PointLanes& lanes, State& state)
      : lanes_(lanes), size_(lanes.images().problem().point_storage()), state_(state) {
    fit_here();
  }

  // Back to `start`, those that cost more than `most` an observation, and less there: what a step
  // has thrown through the plane of a camera, or beyond infinity, no step of its own brings back.
  void return_to(const State& start, double most) {
    bool any = false;
    for (int lane = 0; lane < lanes_.size(); ++lane) any |= is_poor(lane, most);
    if (!any) return;
    const LanePlaces before = lanes_.places_in(start);
    LanePlaces places = here_;
    for (int lane = 0; lane < lanes_.size(); ++lane) {
      if (is_poor(lane, most)) places.copy_lane(lane, before);
    }
    try_places(places);
  }

  // From where their rays meet, in a few steps; back again, those that cost no less there.
  void triangulate_points(double least, char* tries) {
    const LanePlaces places = here_;
    const PlaceFits before = fits_;
    for (int lane = 0; lane < lanes_.size(); ++lane) {
      triangulate(lanes_.images(), state_, point(lane), lanes_.place_in(state_, lane));
      tries[point(lane)] = 1;
    }
    fit_here();
    for (int pass = 0; pass < kTrialPasses; ++pass) step(least, tries);
    for (int lane = 0; lane < lanes_.size(); ++lane) {
      if (!costs_less(fits_.cost[lane], before.cost[lane]))
        places.get(lane, size_, lanes_.place_in(state_, lane));
    }
  }

  // Which cost more than `most` an observation.
  void mark_poor(double most, char* poor) const {
    for (int lane = 0; lane < lanes_.size(); ++lane) poor[point(lane)] = is_poor(lane, most);
  }

  // `tries`, by point: how often in a row it has failed, plus one; 0 where the next step promises
  // less than `least`.
  void step(double least, char* tries) {
    const std::array<bool, kPlaceLanes> taken = try_places(proposals(tries));
    PointLanes::Costs lambda;
    lambda.fill(kDamping);
    PointLanes::Steps next;
    lanes_.step(fits_, lambda, next);
    for (int lane = 0; lane < lanes_.size(); ++lane) {
      char& count = tries[point(lane)];
      count = taken[lane] ? next.promises[lane] > least : static_cast<char>(count + 1);
    }
  }

 private:
  int point(int lane) const { return lanes_.points()[lane]; }
  bool is_poor(int lane, double most) const {
    return !(fits_.cost[lane] <= most * lanes_.num_views(lane));
  }

  void fit_here() {
    here_ = lanes_.places_in(state_);
    lanes_.fit(state_, here_, fits_);
  }

  // Moves those there that cost less there; which they are.
  std::array<bool, kPlaceLanes> try_places(const LanePlaces& places) {
    PlaceFits there;
    lanes_.fit(state_, places, there);
    std::array<bool, kPlaceLanes> taken{};
    for (int lane = 0; lane < lanes_.size(); ++lane) {
      taken[lane] = costs_less(there.cost[lane], fits_.cost[lane]);
      if (!taken[lane]) continue;
      copy_lane(there, lane, fits_);
      here_.copy_lane(lane, places);
      places.get(lane, size_, lanes_.place_in(state_, lane));
    }
    return taken;
  }

  LanePlaces proposals(const char* tries) const {
    PointLanes::Costs lambda{};
    for (int lane = 0; lane < lanes_.size(); ++lane) {
      lambda[lane] = kDamping;
      for (int k = 1; k < tries[point(lane)]; ++k) lambda[lane] *= kRaised;
    }
    PointLanes::Steps steps;
    lanes_.step(fits_, lambda, steps);
    LanePlaces places;
    for (int lane = 0; lane < lanes_.size(); ++lane) {
      double delta[kPointTangent], place[kMaxPointStorage];
      for (int k = 0; k < kPointTangent; ++k) delta[k] = steps.deltas[k][lane];
      plus_point(
          lanes_.images().problem().camera_model, lanes_.place_in(state_, lane), delta, place);
      places.set(lane, size_, place);
    }
    return places;
  }

  const PointLanes& lanes_;
  int size_;
  State& state_;
  LanePlaces here_;
  PlaceFits fits_;  // there
};

}  // namespace

PointRefits::PointRefits(const ImageResiduals& images, const std::vector<char>& movable)
    : images_(images),
      movable_(movable),
      lanes_(images),
      inverse_variance_(images.mean_inverse_variance()),
      tries_(static_cast<std::size_t>(images.graph().num_points)),
      poor_(tries_.size()) {}

long PointRefits::refit(const State& start,
                        const linear::NormalEquations& normal,
                        const linear::Step& step,
                        double cost,
                        State& candidate) {
  std::array<double, 2> count{static_cast<double>(images_.graph().num_points),
                              static_cast<double>(images_.graph().num_observations())};
  images_.exchange().sum(count);
  const double least = kLeastShareOfCost * 2.0 * cost / count[0];
  const double most = kPoorFit * 2.0 * cost / count[1];
  mark_beyond_model(normal, step, least, inverse_variance_ * mean_squared_focal(candidate));
  list_marked(tries_, points_);
  const double refitted = images_.exchange().sum(static_cast<double>(points_.size()));
  poor_points_ = points_;
  for (int pass = 0; pass < kMostPasses && !points_.empty(); ++pass) {
    lanes_.for_each(points_, [&](const PointLanes& lanes) {
      Pass fits(lanes, candidate);
      if (pass == 0) fits.return_to(start, most);
      fits.step(least, tries_.data());
      fits.mark_poor(most, poor_.data());
    });
    keep_marked(tries_, points_);
  }
  keep_marked(poor_, poor_points_);
  lanes_.for_each(poor_points_, [&](const PointLanes& lanes) {
    Pass(lanes, candidate).triangulate_points(least, tries_.data());
  });
  return std::lround(refitted);
}

void PointRefits::mark_beyond_model(const linear::NormalEquations& normal,
                                    const linear::Step& step,
                                    double least,
                                    double focal2) {
  const linear::ObservationGraph& graph = images_.graph();
  linear::for_each_point(images_.pool(), graph.num_points, [&](int p) {
    const PointBlock& v = normal.point_block(p);
    const double* move = step.point.data() + long{kPointTangent} * p;
    const int images = graph.observations_of_point(p);
    const double share =
        images_.is_robust() ? 1.0 : std::min(squared_turn(v, move, images, focal2), 1.0);
    tries_[p] = movable_[p] && squared_move(v, move) * share > least;
  });
}

// Every camera model has its focal length first; that without one has the scale of its images.
double PointRefits::mean_squared_focal(const State& state) const {
  const auto width = static_cast<std::size_t>(images_.problem().num_intrinsics());
  double sum = 0.0;
  for (std::size_t row = 0; row < state.intrinsics.size(); row += width)
    sum += state.intrinsics[row] * state.intrinsics[row];
  return sum * static_cast<double>(width) / static_cast<double>(state.intrinsics.size());
}

}  // namespace sfmcpp::ba

#include "sfmcpp/ba/point_refits.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <vector>

#include "sfmcpp/cameras/camera_model.hpp"
#include "sfmcpp/linear/point_elimination.hpp"
#include "view_rays.hpp"

namespace sfmcpp::ba {
namespace {

using linear::PointBlock;
using optim::State;
using residuals::kReadAhead, residuals::kRecordSize, residuals::kRecordRow;

// The second order of a point matters from this share of what a point costs in the mean on.
constexpr double kLeastShareOfCost = 1e-4;
constexpr int kMostPasses = 6;
// Points are triangulated that still cost more than so many others with as many observations, and
// fitted from there in so many passes.
constexpr double kPoorFit = 4.0;
constexpr int kTrialPasses = 3;
// Of the normal equations of a point; times the other for each step that has failed.
constexpr double kDamping = 1e-4, kRaised = 100.0;
constexpr int kRefitsPerTask = 64;

// The normal equations of a point at a place, and Σ ρ there.
struct Fit {
  PointBlock block{};
  double cost = 0.0;
};

// A cost that is no number is more than any.
bool costs_less(const Fit& fit, const Fit& other) {
  return fit.cost < other.cost || (std::isnan(other.cost) && !std::isnan(fit.cost));
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

void add_row(const double* row, double weight, PointBlock& v) {
  const double a0 = weight * row[0], a1 = weight * row[1], a2 = weight * row[2];
  v.v00 += a0 * row[0];
  v.v10 += a1 * row[0];
  v.v11 += a1 * row[1];
  v.v20 += a2 * row[0];
  v.v21 += a2 * row[1];
  v.v22 += a2 * row[2];
  for (int k = 0; k < 3; ++k) v.rhs[k] += weight * row[k] * row[residuals::kResidualOfU];
}

// δ = (V + λD)⁻¹ b, and what it promises to lower Σ ρ by: bᵀδ, with little damping.
double gauss_newton(const PointBlock& block, double damping, double* delta) {
  const linear::PointFactor factor =
      linear::factor_of(block, {damping, linear::DampingMatrix::kDiagonal});
  linear::multiply_by_transposed_factor(factor, factor.y, delta);
  return block.rhs[0] * delta[0] + block.rhs[1] * delta[1] + block.rhs[2] * delta[2];
}

std::vector<int> marked(const std::vector<char>& marks) {
  std::vector<int> points;
  for (std::size_t p = 0; p < marks.size(); ++p) {
    if (marks[p]) points.push_back(static_cast<int>(p));
  }
  return points;
}

// Some points, as the cameras of a state see them.
class Views {
 public:
  Views(const ImageResiduals& images, const State& state, std::span<const int> points)
      : images_(images), state_(state), num_points_(points.size()) {
    for (int p : points) count_ += images.graph().observations_of_point(p);
    const std::size_t room = static_cast<std::size_t>(count_) + kReadAhead;
    for (std::vector<int>* indices : {&camera_, &row_, &point_}) indices->resize(room);
    for (std::vector<double>* numbers : {&u_, &v_, &inverse_sigma_, &shear_, &stretch_})
      numbers->resize(room);
    records_.resize(kRecordSize * static_cast<std::size_t>(count_));
    gather(points);
  }

  // The point at each place.
  void fit(const residuals::PlaceKernel& kernel,
           const std::vector<double>& places,
           std::vector<Fit>& fits) {
    kernel.linearize({.cameras = state_.cameras.data(),
                      .camera = camera_.data(),
                      .intrinsics = state_.intrinsics.data(),
                      .intrinsics_row = row_.data(),
                      .places = places.data(),
                      .place = point_.data(),
                      .u = u_.data(),
                      .v = v_.data(),
                      .inverse_sigma = inverse_sigma_.data(),
                      .count = count_},
                     records_.data());
    residuals::whiten(shapes_, count_, {nullptr, 0, 0, nullptr, records_.data()});
    fits.assign(num_points_, Fit{});
    for (int k = 0; k < count_; ++k) add(records_.data() + long{kRecordSize} * k, fits[point_[k]]);
  }

  // Where the rays of point p are closest to each other; as it was in a projective world, whose
  // rays have no front. A robust loss allows for wrong observations, and the place would agree with
  // those, too: then only for a point behind a camera, which is lost anyway.
  void triangulate(int p, double* place) const {
    const linear::ObservationGraph& graph = images_.graph();
    visit_camera(images_.problem().camera_model, [&](auto camera) {
      using Camera = decltype(camera);
      if constexpr (Camera::kMetric) {
        const Eigen::Vector3d from(place[0], place[1], place[2]);
        ClosestPlace closest;
        bool is_lost = !images_.is_robust();
        for (int e = graph.point_begin[p]; e < graph.point_begin[p + 1]; ++e) {
          const Ray ray = ray_of<Camera>(images_, state_, graph.of_point[e]);
          closest.add(ray, 1.0);
          is_lost |= ray.along.dot(from - ray.from) <= 0.0;
        }
        const Eigen::Vector3d meeting = closest.place();
        if (is_lost) std::copy_n(meeting.data(), 3, place);
      }
    });
  }

  int num_views(int p) const { return images_.graph().observations_of_point(p); }

 private:
  void gather(std::span<const int> points) {
    const linear::ObservationGraph& graph = images_.graph();
    int next = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const int end = graph.point_begin[points[i] + 1];
      for (int e = graph.point_begin[points[i]]; e < end; ++e)
        set(next++, graph.of_point[e], static_cast<int>(i));
    }
  }

  void set(int k, int observation, int point) {
    const int camera = images_.graph().camera[observation];
    const linear::Chunk one{camera, observation, observation + 1};
    camera_[k] = camera;
    row_[k] = images_.problem().intrinsics_index[camera];
    point_[k] = point;
    u_[k] = images_.u()[observation];
    v_[k] = images_.v()[observation];
    inverse_sigma_[k] = *images_.inverse_sigma(one);
    const residuals::WhitenerShapes shape = images_.shapes(one);
    if (shape.shear == nullptr) return;
    shear_[k] = *shape.shear;
    stretch_[k] = *shape.stretch;
    shapes_ = {shear_.data(), stretch_.data()};
  }

  void add(const double* record, Fit& fit) const {
    const double squared = residuals::squared_residual(record);
    const bool robust = images_.is_robust();
    const double weight = robust ? images_.loss().derivative(squared) : 1.0;
    fit.cost += robust ? images_.loss().rho(squared) : squared;
    add_row(record, weight, fit.block);
    add_row(record + kRecordRow, weight, fit.block);
  }

  const ImageResiduals& images_;
  const State& state_;
  std::size_t num_points_;
  int count_ = 0;
  std::vector<int> camera_, row_, point_;
  std::vector<double> u_, v_, inverse_sigma_, shear_, stretch_, records_;
  residuals::WhitenerShapes shapes_;
};

// A Gauss–Newton step of some points, of each by itself.
class Pass {
 public:
  Pass(const residuals::PlaceKernel& kernel,
       const ImageResiduals& images,
       std::span<const int> points,
       State& state)
      : kernel_(kernel),
        model_(images.problem().camera_model),
        size_(images.problem().point_storage()),
        points_(points),
        state_(state),
        views_(images, state, points) {
    fit_here();
  }

  // Back to `start`, those that cost more than `most` an observation, and less there: what a step
  // has thrown through the plane of a camera, or beyond infinity, no step of its own brings back.
  void return_to(const State& start, double most) {
    std::vector<double> places;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      if (!is_poor(i, most)) continue;
      if (places.empty()) places = places_;
      std::copy_n(place_in(start, i), size_, places.data() + size_ * i);
    }
    if (!places.empty()) take_better(places);
  }

  // From where their rays meet, in a few steps; back again, those that cost no less there.
  void triangulate(double least, char* tries) {
    const std::vector<double> places = places_;
    const std::vector<Fit> before = here_;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      views_.triangulate(points_[i], place_in(state_, i));
      tries[points_[i]] = 1;
    }
    fit_here();
    for (int pass = 0; pass < kTrialPasses; ++pass) step(least, tries);
    for (std::size_t i = 0; i < points_.size(); ++i) {
      if (!costs_less(here_[i], before[i]))
        std::copy_n(places.data() + size_ * i, size_, place_in(state_, i));
    }
  }

  // Which cost more than `most` an observation.
  void mark_poor(double most, char* poor) const {
    for (std::size_t i = 0; i < points_.size(); ++i) poor[points_[i]] = is_poor(i, most);
  }

  // `tries`, by point: how often in a row it has failed, plus one; 0 where the next step promises
  // less than `least`.
  void step(double least, char* tries) {
    for (std::size_t i = 0; i < points_.size(); ++i) propose(i, tries[points_[i]]);
    views_.fit(kernel_, places_, there_);
    for (std::size_t i = 0; i < points_.size(); ++i) judge(i, least, tries[points_[i]]);
  }

 private:
  bool is_poor(std::size_t i, double most) const {
    return !(here_[i].cost <= most * views_.num_views(points_[i]));
  }

  const double* place_in(const State& state, std::size_t i) const {
    return state.points.data() + size_ * static_cast<std::size_t>(points_[i]);
  }
  double* place_in(State& state, std::size_t i) {
    return state.points.data() + size_ * static_cast<std::size_t>(points_[i]);
  }

  void fit_here() {
    places_.resize(size_ * points_.size());
    for (std::size_t i = 0; i < points_.size(); ++i)
      std::copy_n(place_in(state_, i), size_, places_.data() + size_ * i);
    views_.fit(kernel_, places_, here_);
  }

  void take_better(const std::vector<double>& places) {
    views_.fit(kernel_, places, there_);
    for (std::size_t i = 0; i < points_.size(); ++i) {
      if (!costs_less(there_[i], here_[i])) continue;
      here_[i] = there_[i];
      std::copy_n(places.data() + size_ * i, size_, place_in(state_, i));
    }
  }

  void propose(std::size_t i, int tries) {
    double delta[kPointTangent];
    gauss_newton(here_[i].block, kDamping * std::pow(kRaised, tries - 1), delta);
    plus_point(model_, place_in(state_, i), delta, places_.data() + size_ * i);
  }

  void judge(std::size_t i, double least, char& tries) {
    if (!costs_less(there_[i], here_[i])) {
      ++tries;
      return;
    }
    double delta[kPointTangent];
    std::copy_n(places_.data() + size_ * i, size_, place_in(state_, i));
    here_[i] = there_[i];
    tries = gauss_newton(here_[i].block, kDamping, delta) > least;
  }

  const residuals::PlaceKernel& kernel_;
  CameraModel model_;
  std::size_t size_;
  std::span<const int> points_;
  State& state_;
  Views views_;
  std::vector<double> places_;
  std::vector<Fit> here_, there_;
};

}  // namespace

PointRefits::PointRefits(const ImageResiduals& images, const std::vector<char>& movable)
    : images_(images),
      movable_(movable),
      kernel_(residuals::place_kernel(images.problem().camera_model)),
      inverse_variance_(images.mean_inverse_variance()) {}

long PointRefits::refit(const State& start,
                        const linear::NormalEquations& normal,
                        const linear::Step& step,
                        double cost,
                        State& candidate) const {
  std::array<double, 2> count{static_cast<double>(images_.graph().num_points),
                              static_cast<double>(images_.graph().num_observations())};
  images_.exchange().sum(count);
  const double least = kLeastShareOfCost * 2.0 * cost / count[0];
  const double most = kPoorFit * 2.0 * cost / count[1];
  std::vector<char> tries(static_cast<std::size_t>(images_.graph().num_points));
  mark_beyond_model(
      normal, step, least, inverse_variance_ * mean_squared_focal(candidate), tries.data());
  std::vector<int> points = marked(tries);
  const double refitted = images_.exchange().sum(static_cast<double>(points.size()));
  std::vector<char> poor(tries.size());
  for (int pass = 0; pass < kMostPasses && !points.empty(); ++pass, points = marked(tries)) {
    for_parts_of(points, [&](std::span<const int> mine) {
      Pass fits(kernel_, images_, mine, candidate);
      if (pass == 0) fits.return_to(start, most);
      fits.step(least, tries.data());
      fits.mark_poor(most, poor.data());
    });
  }
  for_parts_of(marked(poor), [&](std::span<const int> mine) {
    Pass(kernel_, images_, mine, candidate).triangulate(least, tries.data());
  });
  return std::lround(refitted);
}

// f(part), in parallel.
template <class F>
void PointRefits::for_parts_of(const std::vector<int>& points, const F& f) const {
  images_.pool().parallel_for_parts(
      static_cast<long>(points.size()), kRefitsPerTask, [&](long begin, long end) {
        f(std::span(points).subspan(begin, end - begin));
      });
}

void PointRefits::mark_beyond_model(const linear::NormalEquations& normal,
                                    const linear::Step& step,
                                    double least,
                                    double focal2,
                                    char* beyond) const {
  const linear::ObservationGraph& graph = images_.graph();
  linear::for_each_point(images_.pool(), graph.num_points, [&](int p) {
    const PointBlock& v = normal.point_block(p);
    const double* move = step.point.data() + long{kPointTangent} * p;
    const int images = graph.observations_of_point(p);
    const double share =
        images_.is_robust() ? 1.0 : std::min(squared_turn(v, move, images, focal2), 1.0);
    beyond[p] = movable_[p] && squared_move(v, move) * share > least;
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

#include "sfmcpp/ba/point_refits.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <vector>

#include "sfmcpp/cameras/camera_model.hpp"
#include "sfmcpp/linear/point_elimination.hpp"

namespace sfmcpp::ba {
namespace {

using linear::PointBlock;
using optim::State;
using residuals::kReadAhead;

// The second order of a point matters from this share of its cost on.
constexpr double kShareThatMatters = 1e-4;
constexpr int kPasses = 2;
// Of the normal equations of a point; times the other where a pass has failed.
constexpr double kDamping = 1e-4, kRaised = 100.0;
constexpr int kPointsPerTask = 32;
constexpr int kRecord = 8;  // numbers; see residuals::JacobianOutput
constexpr int kRow = kRecord / 2;

// The normal equations of a point at a place, and Σ ρ there.
struct Fit {
  PointBlock block{};
  double cost = 0.0;
};

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
  for (int k = 0; k < 3; ++k) v.rhs[k] += weight * row[k] * row[kRow - 1];
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
    records_.resize(kRecord * static_cast<std::size_t>(count_));
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
    for (int k = 0; k < count_; ++k) add(records_.data() + long{kRecord} * k, fits[point_[k]]);
  }

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
    const double ru = record[kRow - 1], rv = record[kRecord - 1];
    const double squared = ru * ru + rv * rv;
    const bool robust = images_.is_robust();
    const double weight = robust ? images_.loss().derivative(squared) : 1.0;
    fit.cost += robust ? images_.loss().rho(squared) : squared;
    add_row(record, weight, fit.block);
    add_row(record + kRow, weight, fit.block);
  }

  const ImageResiduals& images_;
  const State& state_;
  std::size_t num_points_;
  int count_ = 0;
  std::vector<int> camera_, row_, point_;
  std::vector<double> u_, v_, inverse_sigma_, shear_, stretch_, records_;
  residuals::WhitenerShapes shapes_;
};

// Gauss–Newton steps of some points, each of which keeps the best place it has met.
class Fitting {
 public:
  Fitting(const residuals::PlaceKernel& kernel,
          const ImageResiduals& images,
          std::span<const int> points,
          State& state)
      : kernel_(kernel),
        model_(images.problem().camera_model),
        size_(images.problem().point_storage()),
        points_(points),
        state_(state),
        views_(images, state, points),
        damping_(points.size(), kDamping) {
    for (int p : points) places_.insert(places_.end(), place_of(p), place_of(p) + size_);
    tried_ = places_;
    views_.fit(kernel_, places_, here_);
  }

  void pass() {
    for (std::size_t i = 0; i < points_.size(); ++i) propose(i);
    views_.fit(kernel_, tried_, there_);
    for (std::size_t i = 0; i < points_.size(); ++i) judge(i);
  }

  void finish() {
    for (std::size_t i = 0; i < points_.size(); ++i)
      std::copy_n(places_.data() + size_ * i, size_, place_of(points_[i]));
  }

 private:
  double* place_of(int p) { return state_.points.data() + static_cast<long>(size_) * p; }

  void propose(std::size_t i) {
    const linear::PointFactor factor =
        linear::factor_of(here_[i].block, {damping_[i], linear::DampingMatrix::kDiagonal});
    double delta[kPointTangent];
    linear::multiply_by_transposed_factor(factor, factor.y, delta);
    plus_point(model_, places_.data() + size_ * i, delta, tried_.data() + size_ * i);
  }

  // A cost that is no number is worse than any.
  void judge(std::size_t i) {
    if (there_[i].cost < here_[i].cost) {
      here_[i] = there_[i];
      std::copy_n(tried_.data() + size_ * i, size_, places_.data() + size_ * i);
    } else {
      damping_[i] *= kRaised;
    }
  }

  const residuals::PlaceKernel& kernel_;
  CameraModelId model_;
  std::size_t size_;
  std::span<const int> points_;
  State& state_;
  Views views_;
  std::vector<double> damping_, places_, tried_;
  std::vector<Fit> here_, there_;
};

}  // namespace

PointRefits::PointRefits(const ImageResiduals& images, const linear::ParameterMap& map)
    : images_(images),
      map_(map),
      kernel_(residuals::place_kernel(images.problem().camera_model)),
      inverse_variance_(images.mean_inverse_variance()) {}

long PointRefits::refit(const linear::NormalEquations& normal,
                        const linear::Step& step,
                        double cost,
                        State& candidate) const {
  const double least =
      kShareThatMatters * 2.0 * cost / images_.exchange().sum(images_.graph().num_points);
  const std::vector<int> points =
      beyond_model(normal, step, least, inverse_variance_ * mean_squared_focal(candidate));
  const auto count = static_cast<long>(points.size());
  images_.pool().parallel_for_parts(count, kPointsPerTask, [&](long begin, long end) {
    Fitting fitting(kernel_, images_, std::span(points).subspan(begin, end - begin), candidate);
    for (int pass = 0; pass < kPasses; ++pass) fitting.pass();
    fitting.finish();
  });
  return std::lround(images_.exchange().sum(static_cast<double>(count)));
}

std::vector<int> PointRefits::beyond_model(const linear::NormalEquations& normal,
                                           const linear::Step& step,
                                           double least,
                                           double focal2) const {
  const linear::ObservationGraph& graph = images_.graph();
  std::vector<char> beyond(static_cast<std::size_t>(graph.num_points), 0);
  linear::for_each_point(images_.pool(), graph.num_points, [&](int p) {
    if (!map_.free_point[p]) return;
    const PointBlock& v = normal.point_block(p);
    const double* move = step.point.data() + long{kPointTangent} * p;
    const int images = graph.observations_of_point(p);
    const double share =
        images_.is_robust() ? 1.0 : std::min(squared_turn(v, move, images, focal2), 1.0);
    beyond[p] = squared_move(v, move) * share > least;
  });
  std::vector<int> points;
  for (int p = 0; p < graph.num_points; ++p) {
    if (beyond[p]) points.push_back(p);
  }
  return points;
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

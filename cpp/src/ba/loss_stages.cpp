#include "sfmcpp/ba/loss_stages.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <utility>
#include <vector>

#include "sfmcpp/math/statistics.hpp"

namespace sfmcpp::ba {
namespace {

using optim::State;

// In one stage, so that what is not yet near is not let go.
constexpr double kMostFall = 0.8;
// Less is not worth another stage.
constexpr double kLeastFall = 0.9;
constexpr double kMostScale = 1e150;  // whose square is a number

// Observations that agree on a point, and the least share of all that are on such points.
constexpr int kAgreeing = 4;
constexpr double kLeastShare = 0.2;
// The median of these, times this, is how far the scale falls.
constexpr double kWidth = 2.0;
// Of normal noise, the largest of a million residuals is 4.5 medians.
constexpr double kMostOfNoise = 6.0;
// Of the scale it has fallen to, how far the last may rise, for wrong observations may lie near
// right ones; and how much rarer they are to be there: pairs that agree by chance count fully up to
// the scale.
constexpr double kReach = 4.0, kRarer = 40.0;
// Of the pairs that are nearest to each other.
constexpr double kNearest = 0.02;

using Pixels = std::vector<std::pair<double, double>>;

// Of each image, over all ranks, in an order that does not depend on how points are cut.
std::vector<Pixels> pixels_of_images(const ImageResiduals& images) {
  const linear::ObservationGraph& graph = images.graph();
  const auto count = static_cast<std::size_t>(graph.num_observations());
  const std::vector<double> cameras(graph.camera.begin(), graph.camera.end());
  const std::vector<double> camera = images.exchange().gather(cameras);
  const std::vector<double> u = images.exchange().gather(std::span(images.u().data(), count));
  const std::vector<double> v = images.exchange().gather(std::span(images.v().data(), count));
  std::vector<Pixels> pixels(static_cast<std::size_t>(graph.num_cameras));
  for (std::size_t k = 0; k < camera.size(); ++k)
    pixels[static_cast<std::size_t>(camera[k])].emplace_back(u[k], v[k]);
  for (Pixels& of_image : pixels) std::ranges::sort(of_image);
  return pixels;
}

// Of each observation from another of its image, which might be any.
std::vector<double> distances_in_images(const ImageResiduals& images) {
  constexpr std::size_t kStride = 7919;  // scatters the numbers of one over those of the other
  std::vector<double> distances;
  for (const Pixels& pixels : pixels_of_images(images)) {
    for (std::size_t k = 0; k < pixels.size(); ++k) {
      const std::size_t other = (k + 1) * kStride % pixels.size();
      if (other != k)
        distances.push_back(std::hypot(pixels[k].first - pixels[other].first,
                                       pixels[k].second - pixels[other].second));
    }
  }
  return distances;
}

// Over which pixels of an image would be spread evenly, were they everywhere as dense as they are
// around another: infinite where there is nothing to learn it from.
double image_area(const ImageResiduals& images) {
  std::vector<double> distances = distances_in_images(images);
  if (distances.empty()) return std::numeric_limits<double>::infinity();
  const auto near = distances.begin() + static_cast<long>(kNearest * double(distances.size()));
  std::nth_element(distances.begin(), near, distances.end());
  const double area = std::numbers::pi * *near * *near / kNearest;
  return area > 0.0 ? area * images.mean_inverse_variance()
                    : std::numeric_limits<double>::infinity();
}

std::vector<double> residual_norms(const ImageResiduals& images, const State& state) {
  const std::vector<double> residuals = images.values(state);
  std::vector<double> norms(residuals.size() / 2);
  for (std::size_t k = 0; k < norms.size(); ++k) {
    const double norm = std::hypot(residuals[2 * k], residuals[2 * k + 1]);
    norms[k] = std::isfinite(norm) ? norm : std::numeric_limits<double>::infinity();
  }
  return norms;
}

// How many observations of each point are as good as `scale`.
std::vector<int> views_within(const linear::ObservationGraph& graph,
                              const std::vector<double>& norms,
                              double scale) {
  std::vector<int> views(static_cast<std::size_t>(graph.num_points));
  for (std::size_t k = 0; k < norms.size(); ++k) views[graph.point[k]] += norms[k] <= scale;
  return views;
}

// Points follow their observations, and two or three of these agree by chance: what counts are
// points on which more agree, within `scale`, as long as they are not too few.
double radius_at(const ImageResiduals& images, double area, const State& state, double scale) {
  const std::vector<double> norms = residual_norms(images, state);
  const std::vector<int> support = views_within(images.graph(), norms, scale);
  const AlignedVector<int>& point = images.graph().point;
  std::vector<double> kept;
  for (int least = kAgreeing; least >= 0; --least) {
    kept.clear();
    std::array<double, 2> near{};  // of such points, and of all
    for (std::size_t k = 0; k < norms.size(); ++k) {
      const bool counts = support[point[k]] >= least;
      if (counts) kept.push_back(norms[k]);
      if (norms[k] <= scale) near[counts ? 0 : 1] += 1.0;
    }
    images.exchange().sum(near);
    if (near[0] > kLeastShare * (near[0] + near[1])) break;
  }
  return radius_of_inliers(images.exchange().gather(kept), area);
}

// Of observations within `scale`, on points with so many of them that chance does not explain it.
double median_within(const ImageResiduals& images, const std::vector<double>& norms, double scale) {
  const std::vector<int> support = views_within(images.graph(), norms, scale);
  std::vector<double> kept;
  for (std::size_t k = 0; k < norms.size(); ++k) {
    if (norms[k] <= scale && support[images.graph().point[k]] >= kAgreeing)
      kept.push_back(norms[k]);
  }
  std::vector<double> of_all_ranks = images.exchange().gather(kept);
  return of_all_ranks.empty() ? scale : median(std::move(of_all_ranks));
}

bool all_within(Exchange& exchange, const std::vector<double>& norms, double scale) {
  const bool beyond = std::ranges::any_of(norms, [&](double norm) { return norm > scale; });
  return exchange.max(beyond ? 1.0 : 0.0) == 0.0;
}

}  // namespace

FallingScale::FallingScale(const ImageResiduals& images, double least)
    : images_(images), least_(std::max(least, kLeastLossScale)), area_(image_area(images)) {}

double FallingScale::at(const State& state) const {
  const double found = radius_at(images_, area_, state, std::numeric_limits<double>::infinity());
  return std::max(std::min(found, kMostScale), least_);
}

double FallingScale::after(double scale, const State& state) const {
  const std::vector<double> norms = residual_norms(images_, state);
  const double median = median_within(images_, norms, scale);
  const double noise = std::max(kMostOfNoise * median, least_);
  if (all_within(images_.exchange(), norms, std::min(noise, scale))) return scale;
  const double next = std::max({kWidth * median, kMostFall * scale, least_});
  return next < kLeastFall * scale ? next : scale;
}

bool FallingScale::keeps_all(double scale, const State& state) const {
  return all_within(images_.exchange(), residual_norms(images_, state), scale);
}

double FallingScale::last(double scale, const State& state) const {
  const double reach = kReach * scale;
  return std::clamp(radius_at(images_, area_ / kRarer, state, reach), scale, reach);
}

namespace {

// A detour's scale, of the one it comes back to.
constexpr double kWide = 2.0;
// A detour that lowers the cost by less than this share is the last of its kind.
constexpr double kLeastGain = 1e-5;

}  // namespace

LossStages::LossStages(ImageResiduals& images,
                       const PointRescues& points,
                       const CameraRescues& cameras,
                       const State& start,
                       double least)
    : images_(images),
      points_(points),
      cameras_(cameras),
      start_(start),
      falling_scale_(images, least) {
  set_scale(falling_scale_.at(start));
}

bool LossStages::sharpen(State& state) {
  if (is_wide_) {
    is_wide_ = false;
    rescues_left_ = 1;
    set_scale(images_.loss().scale / kWide);
    return true;
  }
  if (scale_moves_ && move_scale(state)) return true;
  if (rescues_left_ == 0 || !images_.single_observations()) return false;
  --rescues_left_;
  return points_.rescue(state) > 0;
}

bool LossStages::move_scale(const State& state) {
  const double scale = images_.loss().scale;
  double next = falling_scale_.after(scale, state);
  scale_moves_ = next < scale;
  if (!scale_moves_) next = falling_scale_.last(scale, state);
  set_scale(next);
  return next != scale;
}

bool LossStages::leave(State& state, double cost) {
  if (minimum_) {
    const double gain = minimum_->cost - cost;
    if (!(gain >= kLeastGain * cost)) end_kind();
    if (!(gain > 0.0)) {
      go_back(state);
      return true;
    }
    minimum_.reset();
  }
  LeftMinimum here{state, cost};
  while (detours_ < kDetours) {
    if (set_out(state)) {
      minimum_ = std::move(here);
      return true;
    }
    end_kind();
  }
  return false;
}

// The next detour; whether there is anything to be found on it.
bool LossStages::set_out(State& state) {
  ++detours_;
  if (detours_ > kWideDetours) {
    rescues_left_ = 1;
    return cameras_.rescue(start_, state) > 0;
  }
  if (falling_scale_.keeps_all(images_.loss().scale, state)) return false;
  is_wide_ = true;
  set_scale(kWide * images_.loss().scale);
  return true;
}

bool LossStages::come_back(State& state) {
  if (!minimum_) return false;
  if (is_wide_) set_scale(images_.loss().scale / kWide);
  is_wide_ = false;
  go_back(state);
  return true;
}

void LossStages::go_back(State& state) {
  if (!same_size(state, minimum_->state))
    throw InvalidArgument("saved numbers: not those of this problem");
  state = std::move(minimum_->state);
  minimum_.reset();
}

void LossStages::keep(optim::Archive& archive) {
  double scale = images_.loss().scale;
  archive.keep(scale);
  archive.keep(scale_moves_);
  archive.keep(rescues_left_);
  archive.keep(detours_);
  archive.keep(is_wide_);
  bool left = minimum_.has_value();
  archive.keep(left);
  if (left && !minimum_) minimum_.emplace();
  if (left) archive.keep(*minimum_);
  if (!is_loss_scale(scale)) throw InvalidArgument("saved numbers: not those of these options");
  set_scale(scale);
}

void LeftMinimum::keep(optim::Archive& archive) {
  archive.keep(state.cameras);
  archive.keep(state.intrinsics);
  archive.keep(state.points);
  archive.keep(state.sensors);
  archive.keep(cost);
}

}  // namespace sfmcpp::ba

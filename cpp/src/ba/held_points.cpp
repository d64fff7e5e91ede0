#include "sfmcpp/ba/held_points.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>

namespace sfmcpp::ba {
namespace {

using linear::Chunk;
using optim::State;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// An observation that grows by less than this share of all growth does not matter.
constexpr double kLeastShareOfGrowth = 1e-4;
constexpr int kHalvings = 6;
constexpr int kHeldPointsPerTask = 16;

// By how much a cost grows; infinite where it is no number.
double growth_from(double before, double after) {
  const double growth = after - before;
  return std::isnan(growth) ? kInfinity : std::max(growth, 0.0);
}

}  // namespace

double HeldPoints::growth() const {
  if (by_camera_) return 0.5 * growth_of_cameras();
  double sum = 0.0;
  for (std::size_t c = 0; c < candidate_.size(); ++c) sum += growth_from(start_[c], candidate_[c]);
  return 0.5 * images_.exchange().sum(sum);
}

double HeldPoints::growth_of_cameras() const {
  const linear::ObservationGraph& graph = images_.graph();
  const auto cameras = static_cast<std::size_t>(graph.num_cameras);
  std::vector<CompensatedSum> costs(2 * cameras);  // at the start, then at the candidate
  for (std::size_t c = 0; c < candidate_.size(); ++c) {
    const auto i = static_cast<std::size_t>(graph.chunks[c].camera);
    costs[i] += start_[c];
    costs[cameras + i] += candidate_[c];
  }
  images_.exchange().sum(costs);
  double sum = 0.0;
  for (std::size_t i = 0; i < cameras; ++i)
    sum += growth_from(costs[i].value(), costs[cameras + i].value());
  return sum;
}

long HeldPoints::hold_back(const State& start, State& candidate) const {
  const std::vector<int> points = suspects(start, candidate);
  const auto count = static_cast<int>(points.size());
  const CompensatedSum held =
      images_.pool().sum((count + kHeldPointsPerTask - 1) / kHeldPointsPerTask, [&](int task) {
        double drawn = 0.0;
        const int end = std::min(count, (task + 1) * kHeldPointsPerTask);
        for (int k = task * kHeldPointsPerTask; k < end; ++k)
          drawn += draw_back(start, points[k], candidate) ? 1.0 : 0.0;
        return drawn;
      });
  return std::lround(images_.exchange().sum(held));
}

std::vector<int> HeldPoints::suspects(const State& start, const State& candidate) const {
  const double least = kLeastShareOfGrowth * 2.0 * growth();
  std::vector<char> suspected(static_cast<std::size_t>(images_.graph().num_points), 0);
  images_.pool().parallel_for(static_cast<int>(candidate_.size()), [&](int c) {
    const bool may_grow = by_camera_ ? !(candidate_[c] < least)  // that much, or it is no number
                                     : growth_from(start_[c], candidate_[c]) > 0.0;
    if (may_grow) suspect(start, candidate, c, least, suspected);
  });
  std::vector<int> points;
  for (int p = 0; p < images_.graph().num_points; ++p) {
    if (suspected[p] && movable_[p]) points.push_back(p);
  }
  return points;
}

// Several chunks may suspect a point at once.
void HeldPoints::suspect(const State& start,
                         const State& candidate,
                         int c,
                         double least,
                         std::vector<char>& suspected) const {
  const Chunk& chunk = images_.graph().chunks[c];
  std::array<double, linear::kChunkSize> before, after;
  images_.observation_costs(start, chunk, before.data());
  images_.observation_costs(candidate, chunk, after.data());
  for (int k = 0; k < chunk.end - chunk.begin; ++k) {
    const double growth = growth_from(before[k], after[k]);
    if (growth > 0.0 && growth >= least)
      std::atomic_ref(suspected[images_.graph().point[chunk.begin + k]])
          .store(1, std::memory_order_relaxed);
  }
}

// To half the step, a quarter, … or none of it: the first length at which the point costs no more
// than at the start, else the best. Short lengths that cost least have kept points in local minima.
bool HeldPoints::draw_back(const State& start, int p, State& candidate) const {
  const int size = images_.problem().point_storage();
  const double* from = start.points.data() + images_.problem().point_offset(p);
  double* to = candidate.points.data() + images_.problem().point_offset(p);
  const double enough = cost(start, p, from), whole = cost(candidate, p, to);
  double least = whole;
  std::array<double, kMaxPointStorage> place, best;
  std::copy_n(to, size, best.data());
  for (int halving = 1; least > enough && halving <= kHalvings + 1; ++halving) {
    const double length = halving > kHalvings ? 0.0 : std::ldexp(1.0, -halving);
    for (int k = 0; k < size; ++k) place[k] = from[k] + length * (to[k] - from[k]);
    const double there = cost(candidate, p, place.data());
    if (there >= least) continue;
    least = there;
    best = place;
  }
  std::copy_n(best.data(), size, to);
  return least < whole;
}

// Of a point at a place, as the cameras of a state see it; infinite where it is no number.
double HeldPoints::cost(const State& state, int p, const double* place) const {
  const linear::ObservationGraph& graph = images_.graph();
  double sum = 0.0;
  for (int e = graph.point_begin[p]; e < graph.point_begin[p + 1]; ++e)
    sum += images_.rho(images_.square_at_place(state, graph.of_point[e], place));
  return std::isnan(sum) ? kInfinity : sum;
}

}  // namespace sfmcpp::ba

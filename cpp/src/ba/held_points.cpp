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

// By how much a cost grows; infinite where it is no number.
double growth_from(double before, double after) {
  const double growth = after - before;
  return std::isnan(growth) ? kInfinity : std::max(growth, 0.0);
}

// Some points on their way from a start to a candidate.
class Path {
 public:
  Path(const PointLanes& lanes, const State& start, const State& candidate)
      : lanes_(lanes),
        size_(lanes.images().problem().point_storage()),
        candidate_(candidate),
        from_(lanes.places_in(start)),
        to_(lanes.places_in(candidate)),
        best_(to_) {
    cost(start, from_, enough_);
    cost(candidate, to_, whole_);
    least_ = whole_;
  }

  // Whether any costs more than at the start.
  bool goes_on() const {
    bool any = false;
    for (int lane = 0; lane < lanes_.size(); ++lane) any |= goes_on(lane);
    return any;
  }

  void try_length(double length) {
    LanePlaces there;
    for (int k = 0; k < size_; ++k) {
      for (int lane = 0; lane < lanes_.size(); ++lane) {
        const double from = from_.numbers[k][lane], to = to_.numbers[k][lane];
        there.numbers[k][lane] = from + length * (to - from);
      }
    }
    PointLanes::Costs costs;
    cost(candidate_, there, costs);
    for (int lane = 0; lane < lanes_.size(); ++lane) {
      if (goes_on(lane) && costs[lane] < least_[lane]) take(lane, there, costs[lane]);
    }
  }

  // Moves the points to the best of the places; how many.
  long move(State& candidate) const {
    long moved = 0;
    for (int lane = 0; lane < lanes_.size(); ++lane) {
      if (!(least_[lane] < whole_[lane])) continue;
      best_.get(lane, size_, lanes_.place_in(candidate, lane));
      ++moved;
    }
    return moved;
  }

 private:
  // Infinite where it is no number.
  void cost(const State& cameras, const LanePlaces& places, PointLanes::Costs& costs) const {
    lanes_.cost(cameras, places, costs);
    for (double& sum : costs) sum = std::isnan(sum) ? kInfinity : sum;
  }

  bool goes_on(int lane) const { return least_[lane] > enough_[lane]; }

  void take(int lane, const LanePlaces& places, double cost) {
    least_[lane] = cost;
    best_.copy_lane(lane, places);
  }

  const PointLanes& lanes_;
  int size_;
  const State& candidate_;
  LanePlaces from_, to_, best_;
  PointLanes::Costs enough_, whole_, least_;
};

// To half the step, a quarter, … or none of it: the first length at which a point costs no more
// than at the start, else the best. Short lengths that cost least have kept points in local minima.
// How many points.
long draw_back(const PointLanes& lanes, const State& start, State& candidate) {
  Path path(lanes, start, candidate);
  for (int halving = 1; halving <= kHalvings + 1 && path.goes_on(); ++halving)
    path.try_length(halving > kHalvings ? 0.0 : std::ldexp(1.0, -halving));
  return path.move(candidate);
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
  std::vector<CompensatedSum>& costs = costs_of_cameras_;
  costs.assign(2 * cameras, {});
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

long HeldPoints::hold_back(const State& start, State& candidate) {
  find_suspects(start, candidate);
  std::atomic<long> held = 0;
  lanes_.for_each(suspects_,
                  [&](PointLanes& lanes) { held += draw_back(lanes, start, candidate); });
  return std::lround(images_.exchange().sum(static_cast<double>(held)));
}

void HeldPoints::find_suspects(const State& start, const State& candidate) {
  const double least = kLeastShareOfGrowth * 2.0 * growth();
  suspected_.assign(static_cast<std::size_t>(images_.graph().num_points), 0);
  images_.pool().parallel_for(static_cast<int>(candidate_.size()), [&](int c) {
    const bool may_grow = by_camera_ ? !(candidate_[c] < least)  // that much, or it is no number
                                     : growth_from(start_[c], candidate_[c]) > 0.0;
    if (may_grow) suspect(start, candidate, c, least);
  });
  suspects_.clear();
  for (int p = 0; p < images_.graph().num_points; ++p) {
    if (suspected_[p] && movable_[p]) suspects_.push_back(p);
  }
}

// Several chunks may suspect a point at once. The builtin: Clang's library has no std::atomic_ref
// before version 19.
void HeldPoints::suspect(const State& start, const State& candidate, int c, double least) {
  const Chunk& chunk = images_.graph().chunks[c];
  std::array<double, linear::kChunkSize> before, after;
  images_.observation_costs(start, chunk, before.data());
  images_.observation_costs(candidate, chunk, after.data());
  for (int k = 0; k < chunk.end - chunk.begin; ++k) {
    const double growth = growth_from(before[k], after[k]);
    if (growth > 0.0 && growth >= least)
      __atomic_store_n(&suspected_[images_.graph().point[chunk.begin + k]], 1, __ATOMIC_RELAXED);
  }
}

}  // namespace sfmcpp::ba

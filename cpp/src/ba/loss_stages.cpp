#include "sfmcpp/ba/loss_stages.hpp"

#include <utility>

namespace sfmcpp::ba {
namespace {

using optim::State;

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

void LossStages::keep(optim::Memory& memory) {
  double scale = images_.loss().scale;
  memory.keep(scale);
  memory.keep(scale_moves_);
  memory.keep(rescues_left_);
  memory.keep(detours_);
  memory.keep(is_wide_);
  bool left = minimum_.has_value();
  memory.keep(left);
  if (left && !minimum_) minimum_.emplace();
  if (left) memory.keep(*minimum_);
  if (!is_loss_scale(scale)) throw InvalidArgument("saved numbers: not those of these options");
  set_scale(scale);
}

void LeftMinimum::keep(optim::Memory& memory) {
  memory.keep(state.cameras);
  memory.keep(state.intrinsics);
  memory.keep(state.points);
  memory.keep(state.sensors);
  memory.keep(cost);
}

}  // namespace sfmcpp::ba

#include "sampled_line.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace sfmcpp::optim {

SampledLine::SampledLine(StepLine& line) : line_(line) {
  const linear::Slopes slopes = line.slopes_at_start();
  costs_[0.0] = line.cost_at_start();
  slopes_[0.0] = slopes.camera + slopes.point;
}

double SampledLine::cost(double length) {
  const auto [known, is_new] = costs_.try_emplace(length);
  if (is_new) {
    const double cost = line_.cost({length, length});
    known->second = std::isfinite(cost) ? cost : std::numeric_limits<double>::infinity();
  }
  return known->second;
}

double SampledLine::slope(double length) {
  const auto [known, is_new] = slopes_.try_emplace(length);
  if (is_new) known->second = line_.slope(length);
  return known->second;
}

double SampledLine::best_length() const {
  const auto unit = costs_.find(1.0);
  double best = 1.0;
  double least = unit == costs_.end() ? std::numeric_limits<double>::infinity() : unit->second;
  for (const auto& [length, cost] : costs_) {
    if (length > 0.0 && cost < least) {
      best = length;
      least = cost;
    }
  }
  return best;
}

double SampledLine::parabola_minimum(double low, double high, double least, double greatest) {
  const double width = high - low;
  const double rise = cost(high) - cost(low) - width * slope(low);
  const double fraction = -0.5 * width * slope(low) / rise;
  if (!std::isfinite(rise) || !(rise > 0.0)) return low + 0.5 * width;
  return low + std::clamp(fraction, least, greatest) * width;
}

}  // namespace sfmcpp::optim

#include "sfmcpp/math/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace sfmcpp {

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

double mad_sigma(std::vector<double> centred_values) {
  for (double& value : centred_values) value = std::abs(value);
  return 1.4826 * median(std::move(centred_values));
}

double radius_of_inliers(std::vector<double> distances, double area) {
  constexpr double kLeastInliers = 0.1;  // share of all
  constexpr double kFew = 0.1;           // points that a ring may miss by chance
  constexpr double kDrawn = 1.0 / 500;   // of those beyond: drawn into a ring by what follows them
  std::ranges::sort(distances);
  const auto beyond = [&](double radius) {
    return static_cast<double>(distances.end() - std::ranges::upper_bound(distances, radius));
  };
  double radius = distances[static_cast<std::size_t>(kLeastInliers * double(distances.size()))];
  if (radius == 0.0 && beyond(0.0) > 0.0) radius = *std::ranges::upper_bound(distances, 0.0);
  for (double outside = beyond(radius); outside > 0.0;) {
    // Twice the area.
    const double next = std::numbers::sqrt2 * radius, left = beyond(next);
    const double background = left * std::numbers::pi * radius * radius / area;
    if (outside - left + kFew <= 2.0 * background + kDrawn * left) return radius;
    radius = next;
    outside = left;
  }
  return distances.back();
}

}  // namespace sfmcpp

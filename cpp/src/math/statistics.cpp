#include "sfmcpp/math/statistics.hpp"

#include <algorithm>
#include <cmath>

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

}  // namespace sfmcpp

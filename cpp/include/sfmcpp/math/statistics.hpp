#pragma once

#include <vector>

namespace sfmcpp {

// Median; the mean of the two middle values for an even count. Requires at least one value.
double median(std::vector<double> values);

// Robust standard deviation of centred values: 1.4826 · median |value| (thesis §2.3).
double mad_sigma(std::vector<double> centred_values);

}  // namespace sfmcpp

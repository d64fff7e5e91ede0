#pragma once

#include <vector>

namespace sfmcpp {

// Median; the mean of the two middle values for an even count. Requires at least one value.
double median(std::vector<double> values);

// Robust standard deviation of centred values: 1.4826 · median |value| (thesis §2.3).
double mad_sigma(std::vector<double> centred_values);

// How far from the centre of a scatter of points in the plane they are more than a background that
// is spread evenly over `area`: at the radius given, a ring holds no more than twice what those
// beyond it would leave there (docs/equations.md §4). The largest distance where nothing lies
// beyond. `distances`: from the centre, at least one.
double radius_of_inliers(std::vector<double> distances, double area);

}  // namespace sfmcpp

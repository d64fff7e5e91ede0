// A line on which cost and slope are known where they have been asked for, each asked once.
#pragma once

#include <map>

#include "sfmcpp/optim/line_search.hpp"

namespace sfmcpp::optim {

class SampledLine {
 public:
  explicit SampledLine(StepLine& line);

  double start_cost() const { return costs_.at(0.0); }
  double start_slope() const { return slopes_.at(0.0); }
  // False also where the slope is not a number.
  bool descends() const { return start_slope() < 0.0; }

  double cost(double length);   // infinite where it is not finite
  double slope(double length);  // of a length whose cost is finite
  bool slope_is_known(double length) const { return slopes_.contains(length); }

  int evaluations() const { return static_cast<int>(costs_.size()) - 1; }
  // Of the lengths whose cost has been asked for; the unit length where none is better.
  double best_length() const;

  // Minimum of the parabola through cost and slope at `low` and the cost at `high`, kept between
  // two fractions of the way; the middle where there is no such minimum.
  double parabola_minimum(double low, double high, double least, double greatest);

 private:
  StepLine& line_;
  std::map<double, double> costs_;
  std::map<double, double> slopes_;
};

}  // namespace sfmcpp::optim

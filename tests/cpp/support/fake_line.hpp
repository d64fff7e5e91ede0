// A line whose cost is given by functions, for searches without a problem.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "sfmcpp/optim/line_search.hpp"

namespace sfmcpp::support {

class FakeLine final : public optim::StepLine {
 public:
  using Cost = std::function<double(double x, double y)>;

  // Slopes are central differences of the cost: exact up to the third order, but for rounding.
  explicit FakeLine(Cost cost) : cost_(std::move(cost)) {}

  // A cost and its derivative when both lengths are the same.
  FakeLine(std::function<double(double)> cost, std::function<double(double)> slope)
      : cost_([cost](double x, double) { return cost(x); }), slope_(std::move(slope)) {}

  double cost_at_start() const override { return cost_(0.0, 0.0); }
  linear::Slopes slopes_at_start() const override {
    if (slope_) return {.camera = 0.25 * slope_(0.0), .point = 0.75 * slope_(0.0)};
    return {.camera = (cost_(kStep, 0.0) - cost_(-kStep, 0.0)) / (2.0 * kStep),
            .point = (cost_(0.0, kStep) - cost_(0.0, -kStep)) / (2.0 * kStep)};
  }
  double cost(optim::StepLengths lengths) override {
    ++costs[{lengths.camera, lengths.point}];
    return cost_(lengths.camera, lengths.point);
  }
  double slope(double length) override {
    ++slopes[length];
    return slope_(length);
  }
  std::optional<Biquadratic> algebraic_cost() override { return algebraic; }

  double cost_of(double length) const { return cost_(length, length); }
  double slope_of(double length) const { return slope_(length); }
  double start_slope() const { return slopes_at_start().camera + slopes_at_start().point; }

  // How often each was asked for.
  std::map<std::pair<double, double>, int> costs;
  std::map<double, int> slopes;
  std::optional<Biquadratic> algebraic;

 private:
  static constexpr double kStep = 1e-3;

  Cost cost_;
  std::function<double(double)> slope_;
};

}  // namespace sfmcpp::support

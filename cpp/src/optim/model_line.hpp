// The cost of a model along a step, with the best state met on the way kept.
#pragma once

#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "sfmcpp/optim/line_search.hpp"

namespace sfmcpp::optim {

// Kept from line to line, as it is as large as the model.
struct LineRoom {
  State trial;  // for the second evaluation and those after it
  std::vector<std::pair<StepLengths, double>> evaluated;
};

class ModelLine final : public StepLine {
 public:
  // `best` is room for a state. The references must outlive this object.
  ModelLine(LeastSquaresModel& model,
            const State& start,
            const linear::Step& step,
            double cost_at_start,
            State& best,
            LineRoom& room)
      : model_(model),
        start_(start),
        step_(step),
        cost_at_start_(cost_at_start),
        best_(best),
        trial_(room.trial),
        evaluated_(room.evaluated) {
    evaluated_.clear();
  }

  double cost_at_start() const override { return cost_at_start_; }
  linear::Slopes slopes_at_start() const override {
    return model_.normal_equations().slopes(step_);
  }

  double cost(StepLengths lengths) override {
    for (const auto& [known, cost] : evaluated_) {
      if (known == lengths) return cost;
    }
    const bool first = evaluated_.empty();
    State& target = first ? best_ : trial_;
    model_.plus(start_, step_, lengths, target);
    const double cost = finite_or_infinite(model_.cost(target));
    if (first || cost < best_cost_) {
      if (!first) std::swap(best_, trial_);
      best_lengths_ = lengths;
      best_cost_ = cost;
    }
    evaluated_.emplace_back(lengths, cost);
    return cost;
  }

  double slope(double length) override {
    model_.plus(start_, step_, {length, length}, trial_);
    return model_.slope(start_, step_, trial_);
  }

  std::optional<Biquadratic> algebraic_cost() override {
    return model_.algebraic_cost(start_, step_);
  }

  // Leaves in `best` the state at `lengths`, and returns its cost.
  double settle(StepLengths lengths) {
    const double chosen = cost(lengths);
    if (best_lengths_ != lengths) model_.plus(start_, step_, lengths, best_);
    return chosen;
  }

  int num_evaluations() const { return static_cast<int>(evaluated_.size()); }

 private:
  static double finite_or_infinite(double cost) {
    return std::isfinite(cost) ? cost : std::numeric_limits<double>::infinity();
  }

  LeastSquaresModel& model_;
  const State& start_;
  const linear::Step& step_;
  double cost_at_start_;
  State& best_;
  State& trial_;
  StepLengths best_lengths_;
  double best_cost_ = std::numeric_limits<double>::infinity();
  std::vector<std::pair<StepLengths, double>>& evaluated_;
};

}  // namespace sfmcpp::optim

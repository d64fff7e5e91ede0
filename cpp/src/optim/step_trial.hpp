// What is made of a step: the state it leads to, after a line search or a geodesic acceleration,
// with the points that it spoils held back or refitted.
#pragma once

#include <memory>

#include "model_line.hpp"
#include "sfmcpp/optim/geodesic_acceleration.hpp"
#include "sfmcpp/optim/line_search.hpp"
#include "sfmcpp/optim/model.hpp"
#include "sfmcpp/optim/options.hpp"
#include "sfmcpp/optim/summary.hpp"

namespace sfmcpp::optim {

struct StepCandidate {
  State state;
  double cost = 0.0;
  double unit_cost = 0.0;  // of the step at unit length, from which the strategy learns
};

class StepTrial {
 public:
  // The references must outlive this object.
  StepTrial(LeastSquaresModel& model,
            linear::LinearSolver& solver,
            const MinimizerOptions& options,
            const State& start);

  // Sets the candidate to what `step` makes of `start`, where the normal equations were filled and
  // whose cost is `cost`, and notes in `now` what was done. `share_left`: of the cost, by the step
  // that led to `start`.
  void evaluate(
      const State& start, double cost, double share_left, const linear::Step& step, Iteration& now);

  StepCandidate& candidate() { return candidate_; }

 private:
  bool lowers_the_cost() const { return candidate_.cost < cost_; }
  bool search_is_due(const Iteration& now) const;
  void search(ModelLine& line, Iteration& now);
  bool holding_back_is_due() const;
  void hold_back(const State& start, Iteration& now);
  void accelerate(const State& start, const linear::Step& step, Iteration& now);
  void refit_points(const State& start, const linear::Step& step, Iteration& now);
  void take_cost_at_unit_length(double cost) { candidate_.cost = candidate_.unit_cost = cost; }

  LeastSquaresModel& model_;
  linear::LinearSolver& solver_;
  const MinimizerOptions& options_;
  std::unique_ptr<LineSearch> line_search_;
  GeodesicAcceleration acceleration_;
  PointSteps point_steps_;
  double cost_ = 0.0;  // at the start of the step
  StepCandidate candidate_;
  LineRoom room_;
};

}  // namespace sfmcpp::optim

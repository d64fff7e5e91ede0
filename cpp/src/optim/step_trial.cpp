#include "step_trial.hpp"

#include <algorithm>
#include <utility>

#include "stopping.hpp"

namespace sfmcpp::optim {

StepTrial::StepTrial(LeastSquaresModel& model,
                     linear::LinearSolver& solver,
                     const MinimizerOptions& options,
                     const State& start)
    : model_(model),
      solver_(solver),
      options_(options),
      line_search_(make_line_search(options.line_search)),
      acceleration_(options),
      point_steps_(point_steps_of(options)),
      candidate_{.state = start} {
  if (line_search_) room_.trial = start;
}

void StepTrial::evaluate(
    const State& start, double cost, double share_left, const linear::Step& step, Iteration& now) {
  cost_ = cost;
  ModelLine line(model_, start, step, cost, candidate_.state, room_);
  take_cost_at_unit_length(line.cost(now.lengths));
  if (line_search_ && search_is_due(now)) search(line, now);
  now.cost_evaluations = line.num_evaluations();
  if (holding_back_is_due()) hold_back(start, now);
  if (now.held_points == 0 && acceleration_.is_due(solver_, share_left))
    accelerate(start, step, now);
  if (point_steps_ == PointSteps::kRefitted) refit_points(start, step, now);
}

// Thesis §4.4.3.2: in the first iterations, where λ is large, or where the unit step fails.
bool StepTrial::search_is_due(const Iteration& now) const {
  const LineSearchOptions& when = options_.line_search;
  return now.number <= when.iterations ||
         (when.damping_threshold && now.damping > *when.damping_threshold) ||
         (when.on_rejection && !lowers_the_cost());
}

void StepTrial::search(ModelLine& line, Iteration& now) {
  LineSearchResult result = line_search_->search(line);
  now.line_searched = true;
  now.lengths = result.lengths;
  now.proposed_lengths = std::move(result.proposed);
  candidate_.cost = line.settle(now.lengths);
}

bool StepTrial::holding_back_is_due() const {
  return point_steps_ != PointSteps::kWhole &&
         (!lowers_the_cost() || model_.growth() > kWorthHoldingBack * candidate_.cost);
}

// A failed step of which nothing but a negligible decrease can be saved has failed.
void StepTrial::hold_back(const State& start, Iteration& now) {
  const long held = model_.hold_back(start, candidate_.state);
  if (held == 0) return;
  const double cost = model_.cost(candidate_.state);
  ++now.cost_evaluations;
  const double least = lowers_the_cost() ? 0.0 : options_.termination.function_tolerance;
  if (!(cost_ - cost > least * cost_)) return;
  now.held_points = held;
  take_cost_at_unit_length(cost);
}

// The accelerated step where its cost is lower; the strategy then learns from it. A λ that
// learned from steps without acceleration took a third more of them.
void StepTrial::accelerate(const State& start, const linear::Step& step, Iteration& now) {
  const linear::Step* bent = acceleration_.bend(model_, solver_, start, step);
  if (bent == nullptr) return;
  model_.plus(start, *bent, StepLengths{}, candidate_.state);
  const double cost = model_.cost(candidate_.state);
  ++now.cost_evaluations;
  now.accelerated = cost < candidate_.cost;
  if (now.accelerated) {
    take_cost_at_unit_length(cost);
  } else {
    model_.plus(start, step, StepLengths{}, candidate_.state);
  }
}

void StepTrial::refit_points(const State& start, const linear::Step& step, Iteration& now) {
  now.refitted_points =
      model_.refit(start, step, std::min(cost_, candidate_.cost), candidate_.state);
  if (now.refitted_points == 0) return;
  take_cost_at_unit_length(model_.cost(candidate_.state));
  ++now.cost_evaluations;
}

}  // namespace sfmcpp::optim

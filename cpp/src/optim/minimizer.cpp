#include "sfmcpp/optim/minimizer.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "sfmcpp/linear/step_algebra.hpp"
#include "step_trial.hpp"
#include "stopping.hpp"

namespace sfmcpp::optim {
namespace {

class Minimizer {
 public:
  Minimizer(LeastSquaresModel& model,
            linear::LinearSolver& solver,
            const MinimizerOptions& options,
            const Events& events,
            const Stopwatch& clock,
            State& state)
      : model_(model),
        solver_(solver),
        options_(options),
        events_(events),
        clock_(clock),
        stops_(events, options.termination, clock, model.normal_equations().exchange()),
        state_(state),
        strategy_(make_step_strategy(options)),
        trial_(model, solver, options, state) {}

  MinimizerSummary run(const Resumption* resumed) {
    start();
    if (resumed == nullptr) {
      record();
    } else {
      go_on(*resumed);
    }
    while (!finished()) {
      const bool stands = !make_step();
      if (intrinsics_can_be_freed()) free_intrinsics();
      if (has_settled() && model_.sharpen(state_)) begin_stage();
      if (converged() && model_.leave(state_, cost_)) begin_stage();
      if (stands && finished()) break;
      record();
    }
    if (is_of_a_stop(summary_.termination) && !numbers_.empty()) tell_where_it_stands(true);
    if (!converged() && model_.come_back(state_)) cost_ = model_.linearize(state_);
    summary_.final_cost = cost_;
    return std::move(summary_);
  }

  // Every member that matters to the next iteration, and the history.
  void keep(Archive& archive) {
    archive.keep(summary_.initial_cost);
    archive.keep(summary_.iterations);
    archive.keep(cost_);
    archive.keep(share_left_);
    archive.keep(largest_prediction_);
    archive.keep(holds_intrinsics_);
    strategy_->keep(archive);
    model_.keep(archive);
    std::vector<int> solves = solver_.iterations_of_solves();
    archive.keep(solves);
    if (archive.is_reading()) solver_.replay(solves);
  }

 private:
  void start() {
    summary_.iterations.reserve(1UL + std::min(options_.termination.max_iterations, 200));
    model_.normalize(state_);
    cost_ = summary_.initial_cost = model_.linearize(state_);
    now_ = Iteration{.cost = cost_};
    if (std::isfinite(cost_)) {
      judge_gradient();
      now_.gradient_norm = gradient_norm();
    } else {
      finish(endings::kStartIsNotFinite);
    }
    events_.on_start();
  }

  void go_on(const Resumption& resumed) {
    const double cost_at_start = summary_.initial_cost;
    restore(resumed.numbers, linear::negative_gradient(model_.normal_equations()), *this);
    if (summary_.initial_cost != cost_at_start || summary_.iterations.empty() ||
        !same_size(resumed.state, state_))
      throw InvalidArgument("resumption: is of another problem, other options or another machine");
    numbers_ = resumed.numbers;
    state_ = resumed.state;
    now_ = summary_.iterations.back();
    model_.hold_intrinsics(holds_intrinsics_);
    model_.linearize(state_);
    heed(stops_.agree_on(Signal::kContinue));
  }

  // The last time as after the last iteration: one that was cut short has left the state as it was.
  void tell_where_it_stands(bool last) {
    if (!events_.on_resumable) return;
    if (!last) numbers_ = save(*this);
    events_.on_resumable([this] { return Resumption{state_, numbers_, clock_.seconds()}; }, last);
  }

  void judge_gradient() {
    if (gradient_norm() <= options_.termination.gradient_tolerance && is_flat())
      finish(endings::kGradientIsZero);
  }

  // Whether it came to an answer, or to an accepted state at least, before a stop.
  bool make_step() {
    const double before = cost_;
    std::optional<StopWatcher> watcher;
    if (stops_.are_of_one_rank())
      watcher.emplace(model_.normal_equations().pool(), [this] { return must_end_at_once(); });
    try {
      compute_step();
      if (finished()) return false;
      try_step();
      return true;
    } catch (const Stopped&) {
      if (cost_ == before || !events_.on_resumable) return cost_ != before;
      // A run that goes on later makes the step again, and all that follows from it.
      std::swap(state_, trial_.candidate().state);
      cost_ = before;
      return false;
    }
  }

  void compute_step() {
    solve_for_step(now_.number + 1);
    if (!result_.valid) return;
    largest_prediction_ = std::max(largest_prediction_, result_.predicted_decrease);
    const double length = options_.termination.parameter_tolerance * model_.size(state_);
    const auto& past = summary_.iterations;
    const bool was_long = std::ranges::any_of(past, [&](auto& i) { return i.step_norm > length; });
    // Steps that damping makes short from the start on are tried: after a success they are longer.
    if (now_.step_norm <= length && (was_long || is_flat() || !past.back().accepted)) {
      now_.accepted = false;  // where the run goes on with another stage
      finish_negligible();
    }
  }

  void solve_for_step(int number) {
    now_ = Iteration{.number = number,
                     .damping = strategy_->damping(),
                     .gradient_norm = gradient_norm(),
                     .intrinsics_held = holds_intrinsics_};
    time_ends_step_ = true;
    result_ = strategy_->compute(
        model_.normal_equations(), solver_, [this] { return stop_requested(); }, step_);
    time_ends_step_ = false;
    now_.damping = strategy_->damping();
    now_.linear_solver_iterations = result_.linear_solver_iterations;
    if (result_.valid) now_.step_norm = norm(model_.normal_equations(), step_);
  }

  void try_step() {
    if (result_.valid) trial_.evaluate(state_, cost_, share_left_, step_, now_);
    if (holding_intrinsics_is_due()) try_to_hold_intrinsics();
    if (step_is_successful()) {
      accept();
    } else {
      reject();
    }
  }

  bool holding_intrinsics_is_due() {
    return holds_intrinsics(options_) && !holds_intrinsics_ && !has_moved() && result_.valid &&
           model_.moves_intrinsics_far(state_, trial_.candidate().state);
  }

  bool has_moved() const {
    const auto& past = summary_.iterations;  // the first of them is the start
    return std::any_of(past.begin() + 1, past.end(), [](auto& i) { return i.accepted; });
  }

  // The same step with the intrinsics held, if it leads further down; then the next ones, too. Not
  // after a step of all unknowns was taken: focal lengths that it has moved far may need it.
  void try_to_hold_intrinsics() {
    StepCandidate of_all = trial_.candidate();
    const StepResult result_of_all = result_;
    Iteration now_of_all = now_;
    set_intrinsics_held(true);
    solve_for_step(now_.number);
    if (result_.valid) trial_.evaluate(state_, cost_, share_left_, step_, now_);
    if (step_is_successful() && trial_.candidate().cost < of_all.cost) {
      add_work_of(now_of_all, now_);
      return;
    }
    add_work_of(now_, now_of_all);
    set_intrinsics_held(false);
    std::swap(trial_.candidate(), of_all);
    result_ = result_of_all;
    now_ = now_of_all;
  }

  static void add_work_of(const Iteration& other, Iteration& iteration) {
    iteration.cost_evaluations += other.cost_evaluations;
    iteration.linear_solver_iterations += other.linear_solver_iterations;
  }

  void set_intrinsics_held(bool held) {
    holds_intrinsics_ = held;
    model_.hold_intrinsics(held);
  }

  bool intrinsics_can_be_freed() const {
    if (!holds_intrinsics_) return false;
    if (finished_) return !is_of_a_stop(summary_.termination);
    return gained_at_most(kPosesHaveSettled);
  }

  void free_intrinsics() {
    set_intrinsics_held(false);
    begin_stage();
  }

  // A cost that is not finite compares false.
  bool step_is_successful() { return result_.valid && trial_.candidate().cost < cost_; }

  void accept() {
    const double decrease = cost_ - trial_.candidate().cost;
    std::swap(state_, trial_.candidate().state);
    model_.normalize(state_);
    update_strategy();
    share_left_ = trial_.candidate().cost / cost_;
    cost_ = trial_.candidate().cost;
    if (decrease <= options_.termination.function_tolerance * (cost_ + decrease) &&
        kept_its_promise(decrease, result_.predicted_decrease, negligible()) && is_stationary()) {
      finish(endings::kDecreaseIsSmall);
    } else {
      model_.linearize(state_);
      judge_gradient();
    }
    numbers_.clear();
  }

  // The strategy learns from its own step, at unit length, whatever a line search made of it.
  void update_strategy() {
    const double unit_cost = trial_.candidate().unit_cost;
    if (unit_cost < cost_) {
      strategy_->accepted((cost_ - unit_cost) / result_.predicted_decrease);
    } else {
      strategy_->rejected();
      strategy_->moved();
    }
  }

  void reject() {
    now_.accepted = false;
    strategy_->rejected();
    if (change_is_negligible()) {
      finish(endings::kChangeIsSmall);
    } else if (strategy_->can_retry()) {
      return;
    } else if (!result_.valid) {
      finish(endings::kNotSolved);
    } else if (!facts_of(options_.method).shortens) {
      finish_undamped();
    } else {
      finish_negligible();
    }
  }

  bool converged() const { return finished_ && summary_.termination == Termination::kConverged; }

  bool has_settled() const {
    if (finished_) return converged();
    return gained_at_most(kSettled);
  }

  // Whether the step was taken, for a decrease of no more than this share of the cost.
  bool gained_at_most(double share) const {
    const double before = summary_.iterations.back().cost;
    return now_.accepted && before - cost_ <= share * before;
  }

  // Another cost, or other unknowns, is another problem: what was learned from steps belongs to the
  // last one.
  void begin_stage() {
    finished_ = false;
    cost_ = model_.linearize(state_);
    share_left_ = 1.0;
    strategy_ = make_step_strategy(options_);
  }

  void finish_undamped() {
    if (progressed() && result_.predicted_decrease <= negligible())
      return finish(endings::kPromiseIsSmall);
    finish({progressed() ? Termination::kStalled : Termination::kNumericalFailure,
            endings::kCannotShorten});
  }

  bool progressed() const { return cost_ < summary_.initial_cost; }
  // Steps have become negligible: at a minimum, or because none lowers the cost as predicted.
  void finish_negligible() {
    if (is_flat() || (!progressed() && largest_prediction_ <= negligible() && is_stationary())) {
      finish(endings::kStepIsSmall);
    } else if (progressed()) {
      finish(endings::kStepsBecameSmall);
    } else {
      finish(endings::kNoStepDecreases);
    }
  }

  bool is_flat() const {
    return linear::decrease_by_each_alone(model_.normal_equations()) <= negligible();
  }

  bool is_stationary() const {
    return gradient_is_small(options_.termination, model_.normal_equations(), cost_);
  }
  double negligible() const { return negligible_decrease(options_.termination, cost_); }

  // A rejected step whose predicted and true effect are both below the tolerance: rounding decides.
  bool change_is_negligible() {
    const double tolerated = options_.termination.function_tolerance * cost_;
    return result_.valid && result_.predicted_decrease <= tolerated &&
           std::abs(trial_.candidate().cost - cost_) <= tolerated && is_stationary();
  }

  void record() {
    now_.cost = cost_;
    now_.seconds = clock_.seconds();
    summary_.iterations.push_back(now_);
    if (!finished()) tell_where_it_stands(false);
    heed(stops_.after(now_));
  }

  void heed(Stop stop) {
    const Ending* ending = stops_.ending(stop, now_.number);
    if (ending != nullptr && (is_of_a_listener(stop) || !finished())) finish(*ending);
  }

  // A step that the time limit cuts short is taken, unless the run may be taken up later, where it
  // would not be cut.
  bool stop_requested() {
    time_ends_step_ = false;
    return poll(static_cast<bool>(events_.on_resumable)) != Stop::kNo || finished();
  }

  // Asked between any two tasks. Time that is up leaves no step where the solver does not ask.
  bool must_end_at_once() {
    poll(time_ends_step_);
    return finished();
  }

  Stop poll(bool heeds_time) {
    const Stop stop = stops_.poll();
    if (is_of_a_listener(stop) || (heeds_time && stop == Stop::kTime)) heed(stop);
    return stop;
  }

  double gradient_norm() const { return model_.normal_equations().gradient_max_norm(); }
  bool finished() const { return finished_; }

  void finish(const Ending& ending) {
    finished_ = true;
    summary_.termination = ending.termination;
    summary_.message = ending.message;
  }

  LeastSquaresModel& model_;
  linear::LinearSolver& solver_;
  const MinimizerOptions& options_;
  const Events& events_;
  const Stopwatch& clock_;
  Stops stops_;
  State& state_;
  std::unique_ptr<StepStrategy> strategy_;
  StepTrial trial_;
  bool holds_intrinsics_ = false;

  linear::Step step_;
  StepResult result_;
  Iteration now_;
  double cost_ = 0.0;
  double share_left_ = 1.0;          // of the cost, by the last step taken; of the present stage
  double largest_prediction_ = 0.0;  // largest decrease that the model has predicted
  bool finished_ = false;
  bool time_ends_step_ = false;  // no step can be made of what there is of it
  std::vector<double> numbers_;  // as kept after the last iteration; none where the state has moved
  MinimizerSummary summary_;
};

}  // namespace

MinimizerSummary minimize(LeastSquaresModel& model,
                          linear::LinearSolver& solver,
                          const MinimizerOptions& options,
                          const Events& events,
                          const Stopwatch& clock,
                          State& state,
                          const Resumption* resumed) {
  return Minimizer(model, solver, options, events, clock, state).run(resumed);
}

}  // namespace sfmcpp::optim

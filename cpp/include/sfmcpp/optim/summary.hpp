// What happened: one record per iteration, and why it ended.
#pragma once

#include <array>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "sfmcpp/core/enum_names.hpp"
#include "sfmcpp/optim/archive.hpp"
#include "sfmcpp/optim/state.hpp"

namespace sfmcpp {

namespace optim {
enum class Termination {
  kConverged,
  kMaxIterations,
  kMaxSeconds,
  kInterrupted,
  kStoppedByCallback,
  kStalled,
  kNumericalFailure
};
}

template <>
struct EnumTraits<optim::Termination> {
  static constexpr std::string_view kWhat = "termination";
  static constexpr auto kTable = std::to_array<EnumRow<optim::Termination>>(
      {{optim::Termination::kConverged, "converged"},
       {optim::Termination::kMaxIterations, "max_iterations"},
       {optim::Termination::kMaxSeconds, "max_seconds"},
       {optim::Termination::kInterrupted, "interrupted"},
       {optim::Termination::kStoppedByCallback, "stopped_by_callback"},
       {optim::Termination::kStalled, "stalled"},
       {optim::Termination::kNumericalFailure, "numerical_failure"}});
};

namespace optim {

// Iteration 0 is the start. A rejected step leaves the cost as it was.
struct Iteration {
  int number = 0;
  double cost = 0.0;     // of the current accepted state, over all observations
  double seconds = 0.0;  // since the start of the solve
  bool accepted = true;
  double damping = 0.0;        // λ of the step
  double gradient_norm = 0.0;  // largest entry, at the state the step started from
  double step_norm = 0.0;
  StepLengths lengths{};
  std::vector<StepLengths> proposed_lengths{};  // by an algebraic line search, accepted or not
  bool line_searched = false;
  bool accelerated = false;  // by a geodesic acceleration that lowered the cost
  long held_points = 0;      // drawn back along the step, which made them worse
  long refitted_points = 0;  // far moved by the step, and fitted to the cameras after it
  bool intrinsics_held = false;
  int cost_evaluations = 0;
  int linear_solver_iterations = 0;

  void keep(Archive& archive) {
    for (int* count : {&number, &cost_evaluations, &linear_solver_iterations}) archive.keep(*count);
    for (double* value : {&cost, &seconds, &damping, &gradient_norm, &step_norm})
      archive.keep(*value);
    for (bool* fact : {&accepted, &line_searched, &accelerated, &intrinsics_held})
      archive.keep(*fact);
    archive.keep(lengths);
    archive.keep(proposed_lengths);
    archive.keep(held_points);
    archive.keep(refitted_points);
  }
};

enum class Signal { kContinue, kStop, kInterrupt };

// Listeners of a minimiser: `on_start` once the start is linearised, `on_iteration` after each
// iteration, `poll` from within long ones.
//
// `on_resumable` after each iteration before the end, and once more, as the last, where a limit or
// a listener has ended the run: `where` copies where it stands. All ranks listen, or none.
struct Events {
  std::function<void()> on_start = [] {};
  std::function<Signal(const Iteration&)> on_iteration = [](const Iteration&) {
    return Signal::kContinue;
  };
  std::function<Signal()> poll = [] { return Signal::kContinue; };
  std::function<void(const std::function<Resumption()>& where, bool last)> on_resumable{};
};

struct MinimizerSummary {
  double initial_cost = 0.0;
  double final_cost = 0.0;
  Termination termination = Termination::kMaxIterations;
  std::string message;
  std::vector<Iteration> iterations;
};

}  // namespace optim
}  // namespace sfmcpp

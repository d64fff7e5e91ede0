// The one call: check, choose, minimise, report.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/ba/solve_options.hpp"
#include "sfmcpp/optim/summary.hpp"

namespace sfmcpp::ba {

// Weighted, as it counts in the cost.
struct ConstraintGroupCost {
  std::string name;
  double initial_cost = 0.0;
  double final_cost = 0.0;
};

struct SolveSummary {
  optim::MinimizerSummary minimizer;
  double initial_rms_px =
      0.0;  // sqrt(Σ‖r‖² / 2M), thesis eq. 3.27, of residuals over σ, without loss
  double final_rms_px = 0.0;
  optim::PointSteps point_steps = optim::PointSteps::kWhole;  // what kAuto came to
  bool solves_linear_system = true;  // else the choice of a linear solver means nothing
  linear::LinearSolverChoice linear_solver;
  // Of a step with each solver that was weighed, on this machine if that is worth measuring.
  std::vector<double> forecast_seconds;
  std::vector<linear::SolverChange> solver_changes;
  double loss_scale_px = 1.0;
  int num_threads = 1;
  int behind_camera_initial = 0;  // observations whose point is not in front of the camera
  int behind_camera_final = 0;
  std::vector<ConstraintGroupCost> constraint_costs;  // of each group, in their order
  double seconds_setup = 0.0;
  double seconds_total = 0.0;
  std::vector<std::string> warnings;
};

// `state` starts as state_of(problem) or any other start, and holds the best state found at the
// end. Throws InvalidArgument for a problem or options that break a rule; numerical trouble is a
// value of the summary.
//
// `resumed`: where an earlier solve of the same problem, start and options stood (each rank has its
// own); the result is then, times aside, that of one solve. Its seconds are those of both, and its
// limits are for both.
//
// With several ranks, `problem` and `state` hold all cameras, intrinsics and constraints, and the
// points of this rank with all their observations. Every rank calls this; all end with the same
// cameras, costs, counts and history (core/exchange.hpp).
SolveSummary solve(const Problem& problem,
                   const SolveOptions& options,
                   const optim::Events& events,
                   optim::State& state,
                   Exchange& exchange = this_process(),
                   const optim::Resumption* resumed = nullptr);

// One step, and the costs along it: for pictures and studies of line searches.
struct StepExploration {
  bool valid = false;             // false: the step could not be computed
  std::vector<double> geometric;  // cost at each pair of lengths
  Biquadratic algebraic;          // the algebraic cost along the step
  double damping = 0.0;
};

// Computes the first step from `start` with the method of the options, evaluates the costs at
// `lengths`, and moves `start` along the step at unit length. Throws as `solve` does.
StepExploration explore_step(const Problem& problem,
                             const SolveOptions& options,
                             std::span<const optim::StepLengths> lengths,
                             optim::State& start);

}  // namespace sfmcpp::ba

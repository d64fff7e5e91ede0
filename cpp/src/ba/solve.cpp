#include "sfmcpp/ba/solve.hpp"

#include <cmath>

#include "sfmcpp/ba/check.hpp"
#include "sfmcpp/core/stopwatch.hpp"
#include "sfmcpp/optim/minimizer.hpp"
#include "workspace.hpp"

namespace sfmcpp::ba {
namespace {

double rms(const std::vector<double>& residuals) {
  double sum = 0.0;
  for (double r : residuals) sum += r * r;
  return std::sqrt(sum / static_cast<double>(residuals.size()));
}

void warn_behind(const SolveSummary& summary, std::vector<std::string>& warnings) {
  if (summary.behind_camera_initial + summary.behind_camera_final == 0) return;
  warnings.push_back(
      std::to_string(summary.behind_camera_initial) + " observations at the start and " +
      std::to_string(summary.behind_camera_final) +
      " at the end are of points behind their camera; their residual keeps the formula's value");
}

void describe_start(Workspace& work,
                    const Problem& problem,
                    const SolveOptions& options,
                    const optim::State& state,
                    SolveSummary& summary) {
  const BundleModel::Residuals residuals = work.model.residuals(state);
  work.set_costs(options, residuals.values);
  summary.num_threads = work.pool.num_threads();
  summary.initial_rms_px = rms(residuals.values);
  summary.behind_camera_initial = residuals.behind_camera;
  const bool constrained = work.model.constraints().num_equations() > 0;
  summary.warnings = warnings_about(work.graph, constrained);
  const std::vector<double> costs = work.model.constraints().costs(state);
  for (std::size_t k = 0; k < costs.size(); ++k)
    summary.constraint_costs.push_back({problem.constraints->groups()[k].name, costs[k], costs[k]});
  summary.loss_scale_px = work.loss.scale;
  summary.solves_linear_system = facts_of(options.minimizer.method).solves_linear_system;
  summary.linear_solver = work.choice;
}

void describe_end(Workspace& work, const optim::State& state, SolveSummary& summary) {
  const BundleModel::Residuals residuals = work.model.residuals(state);
  summary.final_rms_px = rms(residuals.values);
  summary.behind_camera_final = residuals.behind_camera;
  const std::vector<double> costs = work.model.constraints().costs(state);
  for (std::size_t k = 0; k < costs.size(); ++k) summary.constraint_costs[k].final_cost = costs[k];
  warn_behind(summary, summary.warnings);
}

}  // namespace

SolveSummary solve(const Problem& problem,
                   const SolveOptions& options,
                   const optim::Events& events,
                   optim::State& state) {
  const Stopwatch clock;
  Workspace work(problem, options, state);
  SolveSummary summary;
  describe_start(work, problem, options, state, summary);
  summary.seconds_setup = clock.seconds();
  {
    const ScopedFrame frame(problem, state);
    summary.minimizer =
        optim::minimize(work.model, *work.solver, options.minimizer, events, clock, state);
  }
  describe_end(work, state, summary);
  summary.seconds_total = clock.seconds();
  return summary;
}

}  // namespace sfmcpp::ba

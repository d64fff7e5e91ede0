#include "sfmcpp/ba/explore.hpp"

#include "sfmcpp/optim/step_strategy.hpp"
#include "workspace.hpp"

namespace sfmcpp::ba {

StepExploration explore_step(const Problem& problem,
                             const SolveOptions& options,
                             std::span<const optim::StepLengths> lengths,
                             optim::State& start) {
  Workspace work(problem, options, start);
  const ScopedFrame frame(problem, start);
  work.model.normalize(start);
  work.model.linearize(start);
  StepExploration result;
  linear::Step step;
  const auto strategy = optim::make_step_strategy(options.minimizer);
  result.valid = strategy
                     ->compute(
                         work.model.normal_equations(), *work.solver, [] { return false; }, step)
                     .valid;
  result.damping = strategy->damping();
  if (!result.valid) return result;
  result.algebraic = work.model.algebraic_cost(start, step).value_or(Biquadratic{});
  optim::State candidate = start;
  for (const optim::StepLengths& l : lengths) {
    work.model.plus(start, step, l, candidate);
    result.geometric.push_back(work.model.cost(candidate));
  }
  work.model.plus(start, step, {}, candidate);
  start = candidate;
  return result;
}

}  // namespace sfmcpp::ba

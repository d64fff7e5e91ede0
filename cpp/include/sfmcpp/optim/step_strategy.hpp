// How a step is computed from the normal equations, and how it learns from success and failure.
//
// A strategy learns only whether its step was accepted and at what gain ratio (actual over
// predicted decrease), so its rule can be tested without any problem. How to add one:
// optim/methods.hpp.
#pragma once

#include <functional>
#include <memory>

#include "sfmcpp/linear/linear_solver.hpp"
#include "sfmcpp/optim/archive.hpp"
#include "sfmcpp/optim/options.hpp"

namespace sfmcpp::optim {

struct StepResult {
  bool valid = false;  // false: the system could not be solved
  double predicted_decrease = 0.0;
  int linear_solver_iterations = 0;
};

class StepStrategy {
 public:
  virtual ~StepStrategy() = default;
  // The normal equations change only after a step was accepted. The solver is for methods that need
  // the damped system solved.
  virtual StepResult compute(const linear::NormalEquations& normal,
                             linear::LinearSolver& solver,
                             const std::function<bool()>& should_stop,
                             linear::Step& step) = 0;
  virtual void accepted(double gain_ratio) = 0;
  virtual void rejected() = 0;
  // After a rejection: a line search has made something of the step, so the normal equations have
  // changed all the same, and what was kept for another try is of a place that was left.
  virtual void moved() {}
  // λ of the step; zero for methods without: Dog-Leg is limited by its radius.
  virtual double damping() const { return 0.0; }
  // Whether another step from the same state can differ after a rejection.
  virtual bool can_retry() const = 0;
  // Hands to `archive` every member that matters to the next step: a strategy of the same options
  // that restores them goes on with the same bits.
  virtual void keep(Archive& archive) = 0;
};

inline std::unique_ptr<StepStrategy> make_step_strategy(const MinimizerOptions& options) {
  return facts_of(options.method).make(options);
}

}  // namespace sfmcpp::optim

// The only minimiser loop. Step strategies, step lengths and linear solvers are composed here.
#pragma once

#include "sfmcpp/core/stopwatch.hpp"
#include "sfmcpp/linear/linear_solver.hpp"
#include "sfmcpp/optim/model.hpp"
#include "sfmcpp/optim/options.hpp"
#include "sfmcpp/optim/step_strategy.hpp"
#include "sfmcpp/optim/summary.hpp"

namespace sfmcpp::optim {

// Minimises from `state`, which holds the best state found when this returns, however it ends. The
// seconds of the iterations are those of `clock`.
//
// `resumed`: where an earlier run from the same start stood; the summary is of both. Throws
// InvalidArgument for what is not of this model and these options, as far as it can tell.
MinimizerSummary minimize(LeastSquaresModel& model,
                          linear::LinearSolver& solver,
                          const MinimizerOptions& options,
                          const Events& events,
                          const Stopwatch& clock,
                          State& state,
                          const Resumption* resumed = nullptr);

}  // namespace sfmcpp::optim

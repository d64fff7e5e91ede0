// One step, and the costs along it: for pictures and studies of line searches.
#pragma once

#include <span>
#include <vector>

#include "sfmcpp/ba/solve.hpp"

namespace sfmcpp::ba {

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

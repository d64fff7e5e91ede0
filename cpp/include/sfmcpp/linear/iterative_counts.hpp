// What the iterative solver does for a step, counted before it is done.
#pragma once

#include "sfmcpp/linear/solver_costs.hpp"

namespace sfmcpp::linear {

struct IterativeCounts {
  double iteration_bytes = 0.0;  // read and written
  double kept_bytes = 0.0;       // besides the normal equations
};

IterativeCounts count_from_jacobian(const SolverCounts& counts);
// With S in blocks.
IterativeCounts count_with_blocks(const SolverCounts& counts);

// Iterations that a step is expected to take with clusters, before any has been taken; later those
// of the last step tell more (Iteration::linear_solver_iterations). The first three steps on a city
// of 3,000 cameras take 84 in the mean, the first four on one of 10,000 take 135, the first eight
// on 1,000 photos 37.
inline constexpr double kExpectedIterations = 100;

}  // namespace sfmcpp::linear

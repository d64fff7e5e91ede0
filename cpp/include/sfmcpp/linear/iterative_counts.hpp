// What the iterative solver does for a step, counted before it is done.
#pragma once

#include "sfmcpp/linear/observation_graph.hpp"

namespace sfmcpp::linear {

// A problem as these counts see it.
struct IterativeSize {
  double cameras = 0.0;
  double points = 0.0;
  double observations = 0.0;
  double pair_updates = 0.0;  // num_pair_updates (reduced_structure.hpp)
  double blocks = 0.0;        // of S on and above the diagonal, if they are formed
  int camera_size = 0;
  double number_bytes = sizeof(double);  // of an entry of the Jacobian
};

struct IterativeCounts {
  double iteration_bytes = 0.0;  // read and written
  double kept_bytes = 0.0;       // besides the normal equations
};

IterativeCounts count_from_jacobian(const IterativeSize& size);
IterativeCounts count_with_blocks(const IterativeSize& size);

// Iterations that a step is expected to take, before any has been taken; later those of the last
// step tell more (Iteration::linear_solver_iterations).
double expected_iterations(const IterativeSize& size);

}  // namespace sfmcpp::linear

// The derivative checks of the product: analytic against numeric derivatives, at the user's own
// state.
#pragma once

#include <string>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/residuals/constraint_set.hpp"

namespace sfmcpp::ba {

struct JacobianCheck {
  long entries = 0;             // derivatives compared
  double worst_error = 0.0;     // |analytic − numeric|, relative to the size of the derivative
  int worst_observation = -1;   // in the caller's order
  std::string worst_parameter;  // for example "rotation y", "centre x", "f", "point z"
};

// Compares the derivatives of at most `max_observations` observations, spread evenly over the
// problem, by every camera, intrinsic and point parameter, fixed or free. Observations whose point
// is not in front of the camera are skipped. Throws InvalidArgument as `solve` does for a broken
// problem.
JacobianCheck check_jacobians(const Problem& problem, int max_observations = 1000);

// The largest difference between the derivatives that the function of a group gives and numeric
// ones, relative to the largest derivative: by poses or by points, whichever is worse, whatever the
// weights. Not a number where the function gives one; 0 for a group without a function or members.
// Throws InvalidArgument as ConstraintSet::check does.
double derivative_error(const Problem& problem, const residuals::ConstraintGroup& group);

}  // namespace sfmcpp::ba

#pragma once

#include <pybind11/pybind11.h>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/residuals/constraint_set.hpp"

namespace sfmcpp::bindings {

// The entry `constraints` of the arrays of a Python problem, a list of dictionaries; empty without
// it. Images of frozen points are those of the problem's intrinsics now, distortion left out.
residuals::ConstraintSet constraints_of(const pybind11::dict& arrays, const ba::Problem& problem);

// What a Python function of a group has raised, raised here; needs the GIL. From then on its
// residuals are no numbers, which ends a solve with the best state so far.
void rethrow_failures(const residuals::ConstraintSet& constraints);

// The value of `f`, unless a Python function has failed in it; whatever else came of that.
template <class F>
auto or_failures_of(const residuals::ConstraintSet& constraints, const F& f) {
  try {
    return f();
  } catch (...) {
    rethrow_failures(constraints);
    throw;
  }
}

}  // namespace sfmcpp::bindings

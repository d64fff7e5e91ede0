#pragma once

#include <pybind11/pybind11.h>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/residuals/constraint_set.hpp"

namespace sfmcpp::bindings {

// The entry `constraints` of the arrays of a Python problem, a list of dictionaries; empty without
// it. Images of frozen points are those of the problem's intrinsics now, distortion left out.
residuals::ConstraintSet constraints_of(const pybind11::dict& arrays, const ba::Problem& problem);

}  // namespace sfmcpp::bindings

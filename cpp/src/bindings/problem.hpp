#pragma once

#include <pybind11/pybind11.h>

#include "sfmcpp/ba/problem.hpp"

namespace sfmcpp::bindings {

// Views of the arrays of a Python problem, by name; `camera_model` is its name.
ba::Problem problem_of(const pybind11::dict& arrays);

}  // namespace sfmcpp::bindings

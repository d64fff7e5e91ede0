#pragma once

#include <pybind11/pybind11.h>

#include "sfmcpp/ba/problem.hpp"

namespace sfmcpp::bindings {

// Views of the arrays of a Python problem, by name; `camera_model` is its name, or a
// CoreCameraFunction that lives as long as they do.
ba::Problem problem_of(const pybind11::dict& arrays);

// What a Python function of the problem has raised, its camera model or one of a group of
// constraints, raised here; needs the GIL.
void rethrow_failures(const ba::Problem& problem);

// The value of `f`, unless a Python function of the problem has failed in it and that made it
// throw.
template <class F>
auto unless_function_failed(const ba::Problem& problem, const F& f) {
  try {
    return f();
  } catch (...) {
    rethrow_failures(problem);
    throw;
  }
}

// The value of `f`, unless a Python function of the problem has failed in it.
template <class F>
auto or_failures_of(const ba::Problem& problem, const F& f) {
  auto value = unless_function_failed(problem, f);
  rethrow_failures(problem);
  return value;
}

}  // namespace sfmcpp::bindings

#pragma once

#include <memory>
#include <string>
#include <variant>

#include <pybind11/pybind11.h>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/core/error.hpp"
#include "sfmcpp/residuals/constraint_set.hpp"
#include "sfmcpp/residuals/loss.hpp"

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

// The entry `constraints` of the arrays of a Python problem, a list of dictionaries; empty without
// it. Images of frozen points are those of the problem's intrinsics now, distortion left out.
residuals::ConstraintSet constraints_of(const pybind11::dict& arrays, const ba::Problem& problem);

// A loss in Python: its name, or a table.
using NamedLoss = std::variant<std::string, std::shared_ptr<LossTable>>;

// As `kind` and `table` have it: the kind of a table is squared.
inline void set_loss(const NamedLoss& named,
                     LossKind& kind,
                     std::shared_ptr<const LossTable>& table) {
  const auto* name = std::get_if<std::string>(&named);
  kind = name != nullptr ? parse_enum<LossKind>(*name) : LossKind::kSquared;
  table = name != nullptr ? nullptr : std::get<std::shared_ptr<LossTable>>(named);
}

}  // namespace sfmcpp::bindings

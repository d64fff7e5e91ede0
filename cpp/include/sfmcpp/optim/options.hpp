#pragma once

#include <array>
#include <limits>
#include <optional>
#include <string_view>
#include <utility>

#include "sfmcpp/core/enum_names.hpp"
#include "sfmcpp/linear/normal_equations.hpp"

namespace sfmcpp {

namespace optim {
enum class Method { kLevenbergMarquardt, kLevenbergMarquardtNielsen, kGaussNewton };
}

template <>
struct EnumNames<optim::Method> {
  static constexpr std::string_view kWhat = "method";
  static constexpr std::array<std::pair<optim::Method, std::string_view>, 3> kTable{
      {{optim::Method::kLevenbergMarquardt, "lm"},
       {optim::Method::kLevenbergMarquardtNielsen, "lm-nielsen"},
       {optim::Method::kGaussNewton, "gauss-newton"}}};
};

template <>
struct EnumNames<linear::DampingMatrix> {
  static constexpr std::string_view kWhat = "damping_matrix";
  static constexpr std::array<std::pair<linear::DampingMatrix, std::string_view>, 2> kTable{
      {{linear::DampingMatrix::kDiagonal, "diagonal"},
       {linear::DampingMatrix::kIdentity, "identity"}}};
};

namespace optim {

// When to stop.
struct TerminationOptions {
  int max_iterations = 50;  // steps tried, rejected ones included
  double max_seconds = std::numeric_limits<double>::infinity();
  double function_tolerance = 1e-6;    // relative decrease of the cost by an accepted step
  double gradient_tolerance = 1e-10;   // largest entry of the gradient
  double parameter_tolerance = 1e-12;  // norm of the step, relative to that of the unknowns
};

struct MinimizerOptions {
  Method method = Method::kLevenbergMarquardtNielsen;
  std::optional<double> initial_damping;  // none: that of the rule
  linear::DampingMatrix damping_matrix = linear::DampingMatrix::kDiagonal;
  TerminationOptions termination;
};

}  // namespace optim
}  // namespace sfmcpp

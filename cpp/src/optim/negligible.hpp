// What is too little to go on for: a decrease of the cost, and when a small one tells of a minimum.
#pragma once

#include <algorithm>

#include "sfmcpp/linear/step_algebra.hpp"
#include "sfmcpp/optim/options.hpp"

namespace sfmcpp::optim {

// Parts of the cost that grow by this share of all of it are worth a look at who grows.
inline constexpr double kWorthHoldingBack = 0.1;
// A cost in stages is sharpened from where a step decreases it by less than this share.
inline constexpr double kSettled = 1e-2;

// Relative decreases of the cost below this are rounding.
inline constexpr double kRounding = 1e-9;
// A cost, in squared standard deviations, far below what any measurement can tell.
inline constexpr double kNegligibleCost = 1e-18;
// A decrease that is a smaller share of what the model promised is that of a step that has failed.
inline constexpr double kKeptPromise = 1e-3;
// Where the unknowns, each alone, promise a larger share of the cost is no minimum; unless so much
// is tolerated.
inline constexpr double kSmallGradient = 1e-3;

inline double negligible_decrease(const TerminationOptions& termination, double cost) {
  return std::max(std::max(kRounding, termination.function_tolerance) * cost, kNegligibleCost);
}

inline bool gradient_is_small(const TerminationOptions& termination,
                              const linear::NormalEquations& normal,
                              double cost) {
  return linear::decrease_by_each_alone(normal) <=
         std::max(kSmallGradient, termination.function_tolerance) * cost;
}

// A step decreases the cost by little at a minimum. It does so elsewhere, too, if it is a long one
// that by chance ends no higher than it began.
inline bool kept_its_promise(double decrease, double promised, double negligible) {
  return promised <= negligible || decrease >= kKeptPromise * promised;
}

}  // namespace sfmcpp::optim

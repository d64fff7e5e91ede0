// All the ways in which a run comes to an end, and how it says so.
#pragma once

#include <algorithm>

#include "sfmcpp/optim/summary.hpp"

namespace sfmcpp::optim {

struct Ending {
  Termination termination;
  const char* message;
};

namespace endings {

using enum Termination;

inline constexpr Ending kStartIsNotFinite{kNumericalFailure, "the cost at the start is not finite"};
inline constexpr Ending kGradientIsZero{kConverged,
                                        "the gradient is zero to within gradient_tolerance"};
inline constexpr Ending kDecreaseIsSmall{kConverged,
                                         "the cost decreases by less than function_tolerance"};
inline constexpr Ending kChangeIsSmall{
    kConverged, "neither the step nor the model changes the cost by function_tolerance"};
inline constexpr Ending kPromiseIsSmall{kConverged,
                                        "the undamped step promises a negligible decrease"};
inline constexpr Ending kStepIsSmall{
    kConverged, "the step is negligible: within parameter_tolerance of the unknowns"};
inline constexpr Ending kStepsBecameSmall{
    kStalled, "the steps have become negligible, but the gradient promises a lower cost"};
inline constexpr Ending kNoStepDecreases{
    kNumericalFailure,
    "no step decreases the cost, though the gradient is not zero: a point may lie in the plane of "
    "its camera"};
inline constexpr Ending kNotSolved{kNumericalFailure, "the normal equations cannot be solved"};
inline constexpr const char* kCannotShorten =
    "the step does not decrease the cost, and the method has no damping to shorten it";

inline constexpr Ending kOutOfTime{kMaxSeconds, "the time limit was reached"};
inline constexpr Ending kOutOfIterations{kMaxIterations, "the limit on iterations was reached"};
inline constexpr Ending kInterruption{kInterrupted, "interrupted; this is the best state so far"};
inline constexpr Ending kCallback{kStoppedByCallback, "the callback asked to stop"};

}  // namespace endings

// Whether a run was stopped, rather than came to an end of its own.
inline bool is_of_a_stop(Termination termination) {
  using enum Termination;
  const auto stops = {kMaxIterations, kMaxSeconds, kInterrupted, kStoppedByCallback};
  return std::ranges::find(stops, termination) != stops.end();
}

}  // namespace sfmcpp::optim

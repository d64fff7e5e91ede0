// How a run ends: its endings and their messages, the tests of convergence, and stops from outside.
#pragma once

#include <algorithm>

#include "sfmcpp/core/exchange.hpp"
#include "sfmcpp/core/stopwatch.hpp"
#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/linear/step_algebra.hpp"
#include "sfmcpp/optim/options.hpp"
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

// Reasons to stop at once, in ascending precedence: the highest that any rank has holds for all.
enum class Stop { kNo, kTime, kCallback, kInterrupt };

inline bool is_of_a_listener(Stop stop) { return stop > Stop::kTime; }

// Stops that a listener or the clock asks for, agreed on by all ranks.
class Stops {
 public:
  Stops(const Events& events,
        const TerminationOptions& limits,
        const Stopwatch& clock,
        Exchange& exchange)
      : events_(events), limits_(limits), clock_(clock), exchange_(exchange) {}

  Stop poll() const { return agree_on(events_.poll()); }
  Stop after(const Iteration& iteration) const { return agree_on(events_.on_iteration(iteration)); }
  Stop agree_on(Signal signal) const {
    const Stop mine = signal == Signal::kInterrupt ? Stop::kInterrupt
                      : signal == Signal::kStop    ? Stop::kCallback
                      : out_of_time()              ? Stop::kTime
                                                   : Stop::kNo;
    return static_cast<Stop>(exchange_.max(static_cast<double>(mine)));
  }
  // What a stop, or the limit on iterations after that one, makes of the run; null: nothing.
  const Ending* ending(Stop stop, int iteration) const {
    if (stop == Stop::kInterrupt) return &endings::kInterruption;
    if (stop == Stop::kCallback) return &endings::kCallback;
    if (stop == Stop::kTime) return &endings::kOutOfTime;
    return iteration >= limits_.max_iterations ? &endings::kOutOfIterations : nullptr;
  }
  // In the middle of an iteration only a single rank can stop: several would wait for each other.
  bool are_of_one_rank() const { return exchange_.num_ranks() == 1; }

 private:
  bool out_of_time() const {
    return limits_.max_seconds && clock_.seconds() >= *limits_.max_seconds;
  }

  const Events& events_;
  const TerminationOptions& limits_;
  const Stopwatch& clock_;
  Exchange& exchange_;
};

// Points are examined, to be held back, where the parts of the cost that grow do so by this share
// of it.
inline constexpr double kWorthHoldingBack = 0.1;
// Intrinsics that are held are freed where a step decreases the cost by less than this share; with
// 30 or 1 % as many runs arrive, after more steps (docs/benchmarks.md, far starts).
inline constexpr double kPosesHaveSettled = 0.1;
// A cost in stages goes on to the next (sharpen) where a step decreases it by less than this share.
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

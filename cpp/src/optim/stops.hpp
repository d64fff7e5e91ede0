#pragma once

#include <algorithm>

#include "sfmcpp/optim/summary.hpp"

namespace sfmcpp::optim {

// Why to stop at once, the gravest reason last: what one rank has met counts for all.
enum class Stop { kNo, kTime, kCallback, kInterrupt };

// Whether a run was stopped, rather than came to an end of its own.
inline bool is_of_a_stop(Termination termination) {
  using enum Termination;
  const auto stops = {kMaxIterations, kMaxSeconds, kInterrupted, kStoppedByCallback};
  return std::ranges::find(stops, termination) != stops.end();
}

}  // namespace sfmcpp::optim

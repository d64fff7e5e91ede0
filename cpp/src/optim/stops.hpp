#pragma once

#include "endings.hpp"
#include "sfmcpp/core/exchange.hpp"
#include "sfmcpp/core/stopwatch.hpp"
#include "sfmcpp/optim/options.hpp"
#include "sfmcpp/optim/summary.hpp"

namespace sfmcpp::optim {

// Why to stop at once, the gravest reason last: what one rank has met counts for all.
enum class Stop { kNo, kTime, kCallback, kInterrupt };

inline bool is_of_a_listener(Stop stop) { return stop > Stop::kTime; }

// What a listener, or the clock, has to say to all ranks.
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
  // Ranks that stopped where each has come to would wait for each other.
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

}  // namespace sfmcpp::optim

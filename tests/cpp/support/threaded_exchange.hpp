// Threads that play the ranks of a cut problem: sums in the order of the ranks, the same bits on
// every one. A rank whose call is not that of the others ends the test with an error, where several
// machines would wait for ever.
#pragma once

#include <algorithm>
#include <exception>
#include <functional>
#include <numeric>
#include <stdexcept>
#include <thread>
#include <vector>

#include "sfmcpp/core/exchange.hpp"
#include "support/barrier.hpp"

namespace sfmcpp::support {

class ThreadedExchange final : public Exchange {
 public:
  enum class Call { kNone, kSum, kMax, kGather, kDeliver, kAgree, kEnd };

  // Where the ranks meet.
  struct Room {
    explicit Room(int num_ranks)
        : gate(num_ranks), calls(num_ranks), brought(num_ranks), counts(num_ranks) {}
    Barrier gate;
    std::vector<Call> calls;
    std::vector<std::vector<double>> brought;
    std::vector<std::vector<int>> counts;  // of what is delivered
  };

  ThreadedExchange(Room& room, int rank) : room_(room), rank_(rank) {}

  using Exchange::deliver;
  using Exchange::max;
  using Exchange::sum;
  int rank() const override { return rank_; }
  int num_ranks() const override { return static_cast<int>(room_.brought.size()); }

  void sum(std::span<double> values) override {
    meet(Call::kSum, values, [&] {
      check_sizes(values.size());
      for (std::size_t k = 0; k < values.size(); ++k) {
        values[k] = 0.0;
        for (const auto& theirs : room_.brought) values[k] += theirs[k];
      }
    });
  }
  void sum(std::span<CompensatedSum> values) override {
    const std::span<double> numbers{reinterpret_cast<double*>(values.data()), 2 * values.size()};
    meet(Call::kSum, numbers, [&] {
      check_sizes(numbers.size());
      for (std::size_t k = 0; k < values.size(); ++k) {
        values[k] = {};
        for (const auto& theirs : room_.brought)
          values[k] += CompensatedSum(theirs[2 * k], theirs[2 * k + 1]);
      }
    });
  }
  void max(std::span<double> values) override {
    meet(Call::kMax, values, [&] {
      check_sizes(values.size());
      for (std::size_t k = 0; k < values.size(); ++k) {
        for (const auto& theirs : room_.brought) values[k] = std::max(values[k], theirs[k]);
      }
    });
  }
  std::vector<double> gather(std::span<const double> values) override {
    std::vector<double> all;
    meet(Call::kGather, values, [&] {
      for (const auto& theirs : room_.brought) all.insert(all.end(), theirs.begin(), theirs.end());
    });
    return all;
  }
  void deliver(std::span<const double> values,
               std::span<const int> counts,
               std::span<double> received,
               std::span<const int> received_counts) override {
    room_.counts[rank_].assign(counts.begin(), counts.end());
    meet(Call::kDeliver, values, [&] {
      auto place = received.begin();
      for (std::size_t r = 0; r < room_.brought.size(); ++r) {
        const std::vector<int>& theirs = room_.counts[r];
        if (theirs[rank_] != received_counts[r])
          throw std::logic_error("a rank is sent what it does not expect");
        const auto first =
            room_.brought[r].begin() + std::reduce(theirs.begin(), theirs.begin() + rank_);
        place = std::copy_n(first, theirs[rank_], place);
      }
    });
  }
  bool agree(bool mine) override {
    const double vote = mine ? 1.0 : 0.0;
    bool any = false;
    meet(Call::kAgree, {&vote, 1}, [&] {
      for (const auto& theirs : room_.brought) any |= theirs[0] > 0.0;
    });
    return any;
  }

  // The last thing a rank does: the others wait for it no more.
  void leave() {
    room_.calls[rank_] = Call::kEnd;
    room_.gate.arrive_and_drop();
  }

 private:
  template <class F>
  void meet(Call call, std::span<const double> values, const F& read) {
    room_.calls[rank_] = call;
    room_.brought[rank_].assign(values.begin(), values.end());
    room_.gate.arrive_and_wait();
    const bool alike = std::all_of(
        room_.calls.begin(), room_.calls.end(), [&](Call theirs) { return theirs == call; });
    if (!alike) throw std::logic_error("the ranks make different calls");
    read();
    room_.gate.arrive_and_wait();
  }
  void check_sizes(std::size_t size) const {
    for (const auto& theirs : room_.brought) {
      if (theirs.size() != size) throw std::logic_error("the ranks bring different numbers");
    }
  }

  Room& room_;
  int rank_;
};

// Calls f(exchange) on a thread for each rank. Throws what the first rank to fail has thrown.
inline void play_ranks(int num_ranks, const std::function<void(Exchange&)>& f) {
  ThreadedExchange::Room room(num_ranks);
  std::vector<std::exception_ptr> errors(num_ranks);
  std::vector<std::thread> threads;
  for (int rank = 0; rank < num_ranks; ++rank) {
    threads.emplace_back([&, rank] {
      ThreadedExchange exchange(room, rank);
      try {
        f(exchange);
      } catch (...) {
        errors[rank] = std::current_exception();
      }
      exchange.leave();
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const std::exception_ptr& error : errors) {
    if (error) std::rethrow_exception(error);
  }
}

}  // namespace sfmcpp::support

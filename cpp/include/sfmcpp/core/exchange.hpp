// The interface through which every sum over observations or points passes.
//
// A problem may be partitioned by points: each rank then holds a part of the points with all their
// observations, and all cameras. What a rank adds up over its own part passes through here before
// it is used, so that every rank goes on with the same numbers; the default is one rank alone.
//
//   partitioned  observations, points, their residuals, steps and blocks: summed over the ranks
//   replicated   cameras, intrinsics, constraints, λD: the same on every rank, so they count once,
//                added by the root or after the sum
//
// Every rank makes the same calls in the same order: whether to make one is decided by replicated
// values alone.
#pragma once

#include <span>
#include <vector>

#include "sfmcpp/core/compensated_sum.hpp"

namespace sfmcpp {

class Exchange {
 public:
  virtual ~Exchange() = default;

  virtual int rank() const = 0;
  virtual int num_ranks() const = 0;
  // Whether this rank is the one that adds replicated terms.
  bool is_root() const { return rank() == 0; }

  // In place, over the ranks and in their order: the same bits on every rank.
  virtual void sum(std::span<double> values) = 0;
  // The same bits for every number of ranks, too.
  virtual void sum(std::span<CompensatedSum> values) = 0;
  virtual void max(std::span<double> values) = 0;
  // The values of all ranks, rank after rank; each may bring another number of them.
  virtual std::vector<double> gather(std::span<const double> values) = 0;
  // counts[r] of the values are for rank r, rank after rank; `received` gets what the ranks have
  // for this one, likewise.
  virtual void deliver(std::span<const double> values,
                       std::span<const int> counts,
                       std::span<double> received,
                       std::span<const int> received_counts) = 0;
  // Whether it is true on any rank.
  virtual bool agree(bool mine) = 0;

  // The same where a rank cannot know how much it gets; it is told `received_counts`, too.
  std::vector<double> deliver(std::span<const double> values,
                              std::span<const int> counts,
                              std::vector<int>& received_counts);

  double sum(double value) {
    sum(std::span(&value, 1));
    return value;
  }
  double sum(CompensatedSum value) {
    sum(std::span(&value, 1));
    return value.value();
  }
  double max(double value) {
    max(std::span(&value, 1));
    return value;
  }
};

// One rank alone: every sum is its own.
Exchange& this_process();

}  // namespace sfmcpp

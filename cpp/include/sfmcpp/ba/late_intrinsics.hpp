// Intrinsics that had better wait until the poses have settled.
//
// Where poses are degrees off, the first steps blame the focal lengths: they change by tens of
// percent to explain what the poses will, cameras crowd together, and the run ends in another
// minimum or crawls along a valley. With the intrinsics held, the same step goes further down.
#pragma once

#include <span>
#include <vector>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/linear/parameter_map.hpp"
#include "sfmcpp/optim/state.hpp"

namespace sfmcpp::ba {

class LateIntrinsics {
 public:
  // `free_intrinsics` as in mask.hpp.
  LateIntrinsics(const Problem& problem,
                 const linear::ParameterMap& map,
                 std::span<const int> free_intrinsics);

  // Whether the free focal lengths of `candidate` are more than 2 % from those of `start`, in the
  // median: |ln f/f₀| of each row of intrinsics. Not of cameras that are a function, whose first
  // parameter may be anything.
  bool have_moved_far(const optim::State& start, const optim::State& candidate) const;

 private:
  std::vector<std::size_t> focal_lengths_;  // in the intrinsics of a state, those that are free
};

}  // namespace sfmcpp::ba

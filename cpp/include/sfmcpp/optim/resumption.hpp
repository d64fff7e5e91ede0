// Where a run stands after an iteration.
#pragma once

#include <vector>

#include "sfmcpp/optim/state.hpp"

namespace sfmcpp::optim {

// A run of the same model and the same options that starts from it goes on with the bits of one
// that did not stop. Each rank has its own.
struct Resumption {
  State state;
  std::vector<double> numbers;  // history, and what the method and the linear solver have learned
  double seconds = 0.0;         // that the run has taken
};

}  // namespace sfmcpp::optim

#pragma once

#include <cmath>

#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/linear/vector_algebra.hpp"
#include "sfmcpp/optim/state.hpp"

namespace sfmcpp::optim {

// Of all unknowns, over all ranks.
inline double norm(const State& state, const linear::NormalEquations& normal) {
  ThreadPool& pool = normal.pool();
  return std::sqrt(linear::squared_norm(pool, state.cameras) +
                   linear::squared_norm(pool, state.intrinsics) +
                   normal.exchange().sum(linear::squared_norm(pool, state.points)));
}

}  // namespace sfmcpp::optim

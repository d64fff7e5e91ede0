#pragma once

#include <cmath>

#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/linear/vector_algebra.hpp"
#include "sfmcpp/optim/state.hpp"

namespace sfmcpp::optim {

inline bool same_size(const State& a, const State& b) {
  return a.cameras.size() == b.cameras.size() && a.intrinsics.size() == b.intrinsics.size() &&
         a.points.size() == b.points.size() && a.sensors.size() == b.sensors.size();
}

// Of all unknowns, over all ranks.
inline double norm(const State& state, const linear::NormalEquations& normal) {
  ThreadPool& pool = normal.pool();
  return std::sqrt(linear::squared_norm(pool, state.cameras) +
                   linear::squared_norm(pool, state.intrinsics) +
                   normal.exchange().sum(linear::squared_norm(pool, state.points)));
}

}  // namespace sfmcpp::optim

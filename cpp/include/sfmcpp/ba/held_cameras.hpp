// Cameras that no image observes and constraints place all the same: a gap that sensors bridge.
#pragma once

#include <cstdint>
#include <vector>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/linear/observation_graph.hpp"
#include "sfmcpp/optim/state.hpp"

namespace sfmcpp::ba {

// Marks the cameras without observations, not fixed, whose poses follow from active constraints
// where all other cameras are known: cameras that constraints tie to each other are looked at
// together, and their Jacobian must have full rank at this state; cameras of a frame (ba/rigs.hpp)
// are one. Empty if there is none.
//
// Throws InvalidArgument for a constraint between two cameras of which one would stay at its start
// for want of observations and of constraints. A camera with constraints on it alone that do not
// determine it stays as it is, like one without any.
std::vector<std::uint8_t> cameras_held_by_constraints(const Problem& problem,
                                                      const linear::ObservationGraph& graph,
                                                      const optim::State& state);

}  // namespace sfmcpp::ba

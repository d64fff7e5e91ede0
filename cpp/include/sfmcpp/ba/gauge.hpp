// The gauge: which pose parameters to hold so that no similarity of the world is left free.
#pragma once

#include <compare>
#include <vector>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/linear/observation_graph.hpp"

namespace sfmcpp::ba {

struct PoseParameter {
  int camera;
  int column;  // of the pose: rotation 0–2, centre 3–5
  auto operator<=>(const PoseParameter&) const = default;
};

// Observed cameras and points that are fixed take away some of the seven degrees of freedom of a
// similarity. For each that is left, one parameter is chosen: those of the first free camera as far
// as they help, then the centre coordinate that the rest moves most (in the usual case: the first
// pose, and the scale through the camera farthest away). Sorted.
std::vector<PoseParameter> choose_gauge(const Problem& problem,
                                        const linear::ObservationGraph& graph);

}  // namespace sfmcpp::ba

// The gauge: which pose parameters to hold so that no similarity of the world is left free.
#pragma once

#include <compare>
#include <vector>

#include <Eigen/Core>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/linear/observation_graph.hpp"

namespace sfmcpp::ba {

struct PoseParameter {
  int camera;  // the first of its frame or of its sensor, whose pose is meant (ba/rigs.hpp)
  int column;  // of the pose: rotation 0–2, centre 3–5; of that of the sensor: 6–8, 9–11
  auto operator<=>(const PoseParameter&) const = default;
};

// If nothing observed is fixed or constrained: the first pose, and for the scale the centre
// coordinate that it moves most. Fixed cameras and points take away some of the seven degrees of
// freedom of a similarity, and so do constraints that a similarity would break: positions all seven
// unless they lie on a line, distances the scale, relative rotations none. For each freedom that is
// left, the pose parameter that it moves most, at this state. Sorted; the same on every rank.
std::vector<PoseParameter> choose_gauge(const Problem& problem,
                                        const linear::ObservationGraph& graph,
                                        const optim::State& state,
                                        Exchange& exchange = this_process());

// The similarities of the world that this holds, orthonormal columns: rotation, translation and
// growth, in units of the scene (world_motions.hpp).
Eigen::MatrixXd free_similarities(const Problem& problem,
                                  const linear::ObservationGraph& graph,
                                  const optim::State& state,
                                  Exchange& exchange = this_process());

}  // namespace sfmcpp::ba

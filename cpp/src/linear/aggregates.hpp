// Aggregates: neighbourhoods of cameras that see many points in common.
#pragma once

#include <vector>

#include "sfmcpp/core/exchange.hpp"
#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/linear/observation_graph.hpp"
#include "sfmcpp/linear/reduced_structure.hpp"

namespace sfmcpp::linear {

// Cameras that the preconditioner of clusters solves for together.
inline constexpr int kCamerasOfCluster = 20;

struct Aggregates {
  std::vector<int> of_camera;  // number of the aggregate of each camera
  std::vector<int> begin;      // cameras of aggregate k: members[begin[k] … begin[k + 1])
  std::vector<int> members;

  int count() const { return static_cast<int>(begin.size()) - 1; }
};

// For each camera those that see points together with it, and how many points.
struct CameraNeighbours {
  std::vector<long> begin;  // neighbours of camera i: [begin[i], begin[i + 1])
  std::vector<int> camera;
  std::vector<float> common;

  int num_cameras() const { return static_cast<int>(begin.size()) - 1; }
};

// Of all ranks, as is the pattern; counts are whole numbers, and the same for any number of ranks.
CameraNeighbours neighbours_of(const ObservationGraph& graph,
                               const CameraPattern& pattern,
                               ThreadPool& pool,
                               Exchange& exchange);

// About `target` cameras in each: grown from a first camera by the one that sees most points
// together with those that are in. Small remainders join the aggregate they see most with.
Aggregates aggregate_cameras(const CameraNeighbours& neighbours, int target);

}  // namespace sfmcpp::linear

// Which camera sees which point, in the two orders the algebra needs.
//
// Observations are stored camera by camera and, within a camera, by ascending point: a camera's
// constants stay in registers while its observations stream by, and a row of the Schur complement
// reads its own half of the coupling blocks in sequence.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/linear/schur_kernels.hpp"

namespace sfmcpp::linear {

// Consecutive observations of one camera: the unit of parallel work and of ordered sums.
inline constexpr int kChunkSize = 512;

struct Chunk {
  int camera;
  int begin;
  int end;
};

struct ObservationGraph {
  int num_cameras = 0;
  int num_points = 0;
  // Observations of camera i: [camera_begin[i], camera_begin[i + 1]).
  std::vector<int> camera_begin;
  AlignedVector<int> camera;  // of each stored observation
  AlignedVector<int> point;   // of each stored observation, with room to read packs beyond the end
  AlignedVector<int> source;  // position of each stored observation in the caller's arrays
  // Entries of `of_point` of point p: [point_begin[p], point_begin[p + 1]).
  AlignedVector<int> point_begin;
  AlignedVector<int> of_point;   // stored observations by point; within a point by ascending camera
  AlignedVector<int> rank;       // where each stored observation stands in `of_point`
  std::vector<Chunk> chunks;     // covers the stored observations in order
  std::vector<int> chunk_begin;  // chunks of camera i: [chunk_begin[i], chunk_begin[i + 1])
  // Observations of each camera on all ranks (core/exchange.hpp); those here unless there are more.
  std::vector<double> of_camera_on_all_ranks;
  // Cameras without observations that other residuals determine (ba/held_cameras.hpp); empty: none.
  std::vector<std::uint8_t> held;

  GraphView view() const {
    return {camera.data(), point.data(), point_begin.data(), of_point.data(), rank.data()};
  }
  int num_observations() const { return static_cast<int>(camera.size()); }
  int observations_of_camera(int i) const { return camera_begin[i + 1] - camera_begin[i]; }
  // On any rank.
  bool is_observed(int i) const { return of_camera_on_all_ranks[i] > 0.0; }
  // Whether images or other residuals determine it.
  bool takes_part(int i) const { return is_observed(i) || (!held.empty() && held[i]); }
  int observations_of_point(int p) const { return point_begin[p + 1] - point_begin[p]; }
};

// Requires every index to be in range; see ba/check.hpp for input from outside.
ObservationGraph make_observation_graph(int num_cameras,
                                        int num_points,
                                        std::span<const int> camera_index,
                                        std::span<const int> point_index);

}  // namespace sfmcpp::linear

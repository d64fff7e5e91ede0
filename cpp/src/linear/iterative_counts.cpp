#include "sfmcpp/linear/iterative_counts.hpp"

#include <algorithm>

#include "sfmcpp/linear/reduced_structure.hpp"

namespace sfmcpp::linear {
namespace {

constexpr double kNumber = sizeof(double);
// Of a core, in order of magnitude: only their ratio matters. Products of small blocks that lie in
// cache, and what streams from memory.
constexpr double kFlops = 25e9;
constexpr double kBytes = 8e9;

// J, A|r and the indices of an observation.
double bytes_of_observation(const IterativeSize& size) {
  return size.number_bytes * (2 * size.camera_size + 8) + 2 * sizeof(int);
}

// M, y, the sum and the shift of a point.
constexpr double kBytesOfPoint = sizeof(PointFactor) + 9 * kNumber;

// Schur–Jacobi and the vectors of conjugate gradients.
double bytes_of_camera(double camera_size) { return kNumber * camera_size * (camera_size + 16); }

// Σ Jᵀ (I − G Gᵀ) J and the right-hand side.
double diagonal_flops(const IterativeSize& size) {
  const double d = size.camera_size;
  return size.observations * (4 * d * d + 20 * d);
}

}  // namespace

IterativeSize iterative_size(const ObservationGraph& graph, int camera_size) {
  return {.cameras = static_cast<double>(graph.num_cameras),
          .points = static_cast<double>(graph.num_points),
          .observations = static_cast<double>(graph.num_observations()),
          .pair_updates = num_pair_updates(graph),
          .camera_size = camera_size};
}

IterativeCounts count_from_jacobian(const IterativeSize& size) {
  const double d = size.camera_size;
  return {.setup_flops = diagonal_flops(size),
          .setup_bytes = size.observations * bytes_of_observation(size),
          .iteration_flops = size.observations * (12 * d + 24) + size.cameras * 4 * d * d,
          .iteration_bytes = 2 * size.observations * bytes_of_observation(size) +
                             size.points * kBytesOfPoint + size.cameras * bytes_of_camera(d),
          .kept_bytes = kNumber * (9 * size.points + size.cameras * 2 * d * d)};
}

// With the preconditioner of clusters, in single precision and read twice by halves.
IterativeCounts count_with_blocks(const IterativeSize& size) {
  constexpr double kCluster = 20;
  const double d = size.camera_size;
  const double above = size.blocks - size.cameras;
  const double bytes = above * (sizeof(float) * d * d + sizeof(int));
  const double of_clusters = size.cameras * kCluster * d * d * sizeof(float);
  const double pairs = size.pair_updates * (4 * d * d + 8 * d);
  const double factors = size.cameras * kCluster * kCluster * d * d * d / 3;
  return {.setup_flops = diagonal_flops(size) + pairs + factors,
          .setup_bytes = size.observations * bytes_of_observation(size) + 2 * bytes,
          .iteration_flops = above * 4 * d * d + size.cameras * (6 * d * d + 2 * kCluster * d * d),
          .iteration_bytes =
              bytes + of_clusters + size.cameras * (kNumber * d * d + bytes_of_camera(d)),
          .kept_bytes = bytes + of_clusters +
                        kNumber * (6 * size.points + size.cameras * (2 * d * d + 18 * d))};
}

// Of a step, with clusters: the first three on a city of 3,000 cameras take 84 in the mean, the
// first four on one of 10,000 take 135, the first eight on 1,000 photos 37.
double expected_iterations(const IterativeSize&) { return 100; }

bool blocks_pay(const IterativeSize& size) {
  const double iterations = expected_iterations(size);
  const auto seconds = [&](const IterativeCounts& c) {
    return std::max(c.setup_flops / kFlops, c.setup_bytes / kBytes) +
           iterations * std::max(c.iteration_flops / kFlops, c.iteration_bytes / kBytes);
  };
  return seconds(count_with_blocks(size)) < seconds(count_from_jacobian(size));
}

}  // namespace sfmcpp::linear

#include "sfmcpp/linear/iterative_counts.hpp"

#include "sfmcpp/linear/schur_kernels.hpp"

namespace sfmcpp::linear {
namespace {

constexpr double kNumber = sizeof(double);

// J, A|r and the indices of an observation.
double bytes_of_observation(const SolverCounts& counts) {
  return counts.number_bytes * (2 * counts.camera_size + 8) + 2 * sizeof(int);
}

// M, y, the sum and the shift of a point.
constexpr double kBytesOfPoint = sizeof(PointFactor) + 9 * kNumber;

// Schur–Jacobi and the vectors of conjugate gradients.
double bytes_of_camera(double camera_size) { return kNumber * camera_size * (camera_size + 16); }

}  // namespace

IterativeCounts count_from_jacobian(const SolverCounts& counts) {
  const double d = counts.camera_size;
  return {.iteration_bytes = 2 * counts.observations * bytes_of_observation(counts) +
                             counts.points * kBytesOfPoint + counts.cameras * bytes_of_camera(d),
          .kept_bytes = kNumber * (9 * counts.points + counts.cameras * 2 * d * d)};
}

// With the preconditioner of clusters, in single precision and read twice by halves.
IterativeCounts count_with_blocks(const SolverCounts& counts) {
  constexpr double kCluster = 20;
  const double d = counts.camera_size;
  const double above = counts.blocks - counts.cameras;
  const double bytes = above * (sizeof(float) * d * d + sizeof(int));
  const double of_clusters = counts.cameras * kCluster * d * d * sizeof(float);
  return {.iteration_bytes =
              bytes + of_clusters + counts.cameras * (kNumber * d * d + bytes_of_camera(d)),
          .kept_bytes = bytes + of_clusters +
                        kNumber * (6 * counts.points + counts.cameras * (2 * d * d + 18 * d))};
}

}  // namespace sfmcpp::linear

// A bundle adjustment problem as views of the caller's arrays: nothing is copied until a solve.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "sfmcpp/cameras/camera_model.hpp"
#include "sfmcpp/core/exchange.hpp"
#include "sfmcpp/linear/observation_graph.hpp"
#include "sfmcpp/optim/state.hpp"

namespace sfmcpp::residuals {
class ConstraintSet;
}

namespace sfmcpp::ba {

// Cameras that are rigid to each other (ba/rigs.hpp). Empty: none are.
struct Rigs {
  std::span<const double> sensors{};             // S × 12, row-major: [R | t] rig_from_sensor
  std::span<const int> frame_of_camera{};        // C
  std::span<const int> sensor_of_camera{};       // C
  std::span<const std::uint8_t> free_sensors{};  // S, nonzero: free; or empty: none (ba/rigs.hpp)

  bool empty() const { return frame_of_camera.empty(); }
  int num_sensors() const { return static_cast<int>(sensors.size() / kCameraStorage); }
  bool any_free() const {
    return std::ranges::any_of(free_sensors, [](std::uint8_t entry) { return entry != 0; });
  }
};

// C cameras, G rows of K intrinsic parameters, N points, M observations. The spans must outlive
// every use of the problem. A solve reads cameras, intrinsics and points from its state alone: here
// they are the start that state_of() copies.
struct Problem {
  CameraModel camera_model = CameraModelId::kCalibrated;
  std::span<const double> cameras;           // C × 12, row-major: [R | c] world_from_camera, or P
  std::span<const double> intrinsics;        // G × K, each row as intrinsic_names() has them
  std::span<const double> points;            // N × 3, or N × 4 homogeneous
  std::span<const int> intrinsics_index;     // C: row of intrinsics of each camera
  std::span<const int> camera_index;         // M
  std::span<const int> point_index;          // M
  std::span<const double> pixels;            // M × 2
  std::span<const double> sigma_px{};        // M, or empty for 1 px
  std::span<const double> covariance_px2{};  // M × 2 × 2 instead of σ, or empty
  Rigs rigs{};
  // What stays as it is: where an entry is not zero; empty: nothing.
  std::span<const std::uint8_t> fixed_cameras{};          // C: with rigs, whole frames
  std::span<const std::uint8_t> fixed_points{};           // N
  std::span<const std::uint8_t> fixed_intrinsics{};       // G × K
  const residuals::ConstraintSet* constraints = nullptr;  // null: none

  int num_cameras() const { return static_cast<int>(cameras.size() / kCameraStorage); }
  int num_intrinsics() const { return static_cast<int>(intrinsic_names(camera_model).size()); }
  int num_groups() const {
    return static_cast<int>(intrinsics.size() / static_cast<std::size_t>(num_intrinsics()));
  }
  int point_storage() const { return sfmcpp::point_storage(camera_model); }
  int num_points() const {
    return static_cast<int>(points.size() / static_cast<std::size_t>(point_storage()));
  }
  int num_observations() const { return static_cast<int>(camera_index.size()); }

  bool is_fixed_camera(int i) const { return !fixed_cameras.empty() && fixed_cameras[i] != 0; }
  bool is_fixed_point(long p) const { return !fixed_points.empty() && fixed_points[p] != 0; }
  bool is_fixed_intrinsic(std::size_t k) const {
    return !fixed_intrinsics.empty() && fixed_intrinsics[k] != 0;
  }

  // Where the numbers of a camera, of a row of intrinsics, of the row of a camera, and of a point
  // begin in their arrays: those of a state too, and `fixed_intrinsics`.
  std::size_t camera_offset(int i) const { return kCameraStorage * static_cast<std::size_t>(i); }
  std::size_t row_offset(int row) const {
    return static_cast<std::size_t>(num_intrinsics()) * static_cast<std::size_t>(row);
  }
  std::size_t intrinsics_offset(int camera) const { return row_offset(intrinsics_index[camera]); }
  std::size_t point_offset(int p) const {
    return static_cast<std::size_t>(point_storage()) * static_cast<std::size_t>(p);
  }
};

// A copy of the unknowns.
optim::State state_of(const Problem& problem);

// Which camera sees which point of this rank, and how often each camera sees one of any. Requires
// every index to be in range (check_arrays).
linear::ObservationGraph graph_of(const Problem& problem, Exchange& exchange = this_process());
// The same without the sums over the ranks.
linear::ObservationGraph graph_of_this_rank(const Problem& problem);

// A problem as cameras without distortion see it: projection matrices and pixels.

// 3×4, row-major, to pixels, for each camera: K [Rᵀ | −Rᵀc] of metric ones.
void projection_matrices(const Problem& problem, double* matrices);

// Two numbers per observation: where a lens of the same pinhole without distortion would have seen
// it.
void undistort_pixels(const Problem& problem, double* pixels);

}  // namespace sfmcpp::ba

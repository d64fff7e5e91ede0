// Seeded scenes for tests and benchmarks: cameras on a circle of 10 m look at points in a cube of 6
// m.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/residuals/constraint_set.hpp"

namespace sfmcpp::support {

struct SceneOptions {
  CameraModelId camera_model = CameraModelId::kCalibrated;
  int num_cameras = 6;
  int num_points = 40;
  int window = 0;  // neighbouring cameras that see a point; 0: every camera sees every point
  int num_groups =
      0;  // rows of intrinsics that the cameras share in turn; 0: a row for each camera
  std::optional<std::vector<int>> free_intrinsics{};  // none: those a user gets by default
  double noise_px = 0.0;                              // of the pixels, where sigma_px is 1
  bool varied_sigma = false;  // sigma_px of 0.5, 1 and 2 px in turn, the noise with it
  bool covariances = false;  // three covariance_px2 in turn, one of them σ²I, the noise with them
  double rotation_error_rad = 0.0;  // of the start, standard deviation per coordinate
  double centre_error_m = 0.0;
  double point_error_m = 0.0;
  double intrinsics_error = 0.0;  // relative, of the free ones
  unsigned seed = 1;
};

// The arrays that a ba::Problem views. They hold the start; `truth` what made the pixels.
struct OwnedProblem {
  CameraModelId camera_model = CameraModelId::kCalibrated;
  std::vector<double> cameras, intrinsics, points, pixels, sigma_px, covariance_px2;
  std::vector<int> intrinsics_index, camera_index, point_index;
  std::vector<std::uint8_t> fixed_cameras, fixed_points, fixed_intrinsics;
  residuals::ConstraintSet constraints;
  optim::State truth;

  ba::Problem view() const;
  void start_from(const optim::State& state);
  void observe(int camera, int point, double u, double v);
};

// For a model that is not metric: the scene of calibrated cameras, in coordinates of norm one.
OwnedProblem make_circle_scene(const SceneOptions& options);

// Observations in random places of the image, a share of all; whether each is one of them.
std::vector<bool> spoil(OwnedProblem& problem, double share, unsigned seed = 1);

// A start a few percent off the truth, with half a pixel of noise: what most tests solve.
SceneOptions perturbed(CameraModelId model);

}  // namespace sfmcpp::support

#include "sfmcpp/ba/algebraic_cost.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "sfmcpp/cameras/visit_camera.hpp"

namespace sfmcpp::ba {
namespace {

// Seen from an image whose observations coincide, every scale is as good.
constexpr double kMinScale = 1e-9;

// N M, with N = diag(1/s, 1/s, 1) · translation by −centre.
void normalize_rows(const ImageNormalization& n, const double* m, double* out) {
  for (int k = 0; k < 4; ++k) {
    out[k] = (m[k] - n.centre_u * m[8 + k]) / n.scale;
    out[4 + k] = (m[4 + k] - n.centre_v * m[8 + k]) / n.scale;
    out[8 + k] = m[8 + k];
  }
}

std::vector<double> rounded(const std::vector<CompensatedSum>& sums) {
  std::vector<double> values(sums.size());
  round_sums(sums, values);
  return values;
}

}  // namespace

AlgebraicCost::AlgebraicCost(const ImageResiduals& images,
                             const linear::ParameterMap& map,
                             const std::vector<int>& free_intrinsics)
    : images_(images),
      problem_(images.problem()),
      graph_(images.graph()),
      map_(map),
      free_intrinsics_(free_intrinsics),
      frames_(problem_, sensor_column(problem_, free_intrinsics.size())),
      kernel_(residuals::algebraic_kernel(problem_.camera_model)) {}

// Once for all line searches (thesis §4.2.2), and only if there is one. An image has observations
// on every rank.
void AlgebraicCost::normalize_images() {
  if (!normalizations_.empty()) return;
  const auto cameras = static_cast<std::size_t>(graph_.num_cameras);
  std::vector<CompensatedSum> centre_sums(2 * cameras), distance_sums(cameras);
  for (int k = 0; k < graph_.num_observations(); ++k) {
    const auto i = static_cast<std::size_t>(graph_.camera[k]);
    centre_sums[2 * i] += images_.u()[k] / graph_.of_camera_on_all_ranks[i];
    centre_sums[2 * i + 1] += images_.v()[k] / graph_.of_camera_on_all_ranks[i];
  }
  images_.exchange().sum(centre_sums);
  const std::vector<double> centres = rounded(centre_sums);
  for (int k = 0; k < graph_.num_observations(); ++k) {
    const auto i = static_cast<std::size_t>(graph_.camera[k]);
    distance_sums[i] +=
        std::hypot(images_.u()[k] - centres[2 * i], images_.v()[k] - centres[2 * i + 1]) /
        graph_.of_camera_on_all_ranks[i];
  }
  images_.exchange().sum(distance_sums);
  const std::vector<double> distances = rounded(distance_sums);
  for (std::size_t i = 0; i < cameras; ++i) {
    normalizations_.push_back(
        {centres[2 * i], centres[2 * i + 1], std::max(distances[i] / std::sqrt(2.0), kMinScale)});
  }
}

AlgebraicCost::CameraLine AlgebraicCost::camera_line(const optim::State& state,
                                                     const linear::Step& step,
                                                     int camera) const {
  std::array<double, linear::kMaxCameraSize> delta{};
  map_.expand(step.camera.data(), camera, delta.data());
  if (frames_.any()) frames_.motion(state, camera).move(delta.data());
  const int tangent = camera_tangent(problem_.camera_model);
  std::array<double, linear::kMaxCameraSize> intrinsics_delta{};
  for (std::size_t k = 0; k < free_intrinsics_.size(); ++k)
    intrinsics_delta[free_intrinsics_[k]] = delta[tangent + k];
  const double* stored = state.cameras.data() + problem_.camera_offset(camera);
  const double* intrinsics = state.intrinsics.data() + problem_.intrinsics_offset(camera);
  MatrixAndChange line;
  visit_camera(problem_.camera_model, [&](auto type) {
    decltype(type)::matrix(stored, intrinsics, delta.data(), intrinsics_delta.data(), line);
  });
  CameraLine normalized;
  normalize_rows(normalizations_[camera], line.matrix, normalized.matrix);
  normalize_rows(normalizations_[camera], line.change, normalized.change);
  return normalized;
}

Biquadratic AlgebraicCost::along(const optim::State& state,
                                 const linear::Step& step,
                                 std::span<const double> weights,
                                 AlgebraicWeights algebraic_weights) {
  normalize_images();
  std::vector<residuals::AlgebraicSums> sums(graph_.chunks.size());
  images_.pool().parallel_for(static_cast<int>(sums.size()), [&](int c) {
    const linear::Chunk& chunk = graph_.chunks[c];
    const CameraLine line = camera_line(state, step, chunk.camera);
    const ImageNormalization& n = normalizations_[chunk.camera];
    residuals::ObservationBatch observations = images_.batch(state, chunk);
    if (!weights.empty()) observations.inverse_sigma = weights.data() + chunk.begin;
    sums[c] = kernel_.sums({.observations = observations,
                            .matrix = line.matrix,
                            .change = line.change,
                            .point_steps = step.point.data(),
                            .centre_u = n.centre_u,
                            .centre_v = n.centre_v,
                            .scale = n.scale,
                            .weigh_by_depth = algebraic_weights == AlgebraicWeights::kInverseDepth,
                            .shapes = images_.shapes(chunk)});
  });
  std::vector<CompensatedSum> total(residuals::kAlgebraicSums);
  for (const residuals::AlgebraicSums& sum : sums) {
    for (std::size_t k = 0; k < total.size(); ++k)
      total[k] += CompensatedSum(sum.sums[k], sum.rests[k]);
  }
  images_.exchange().sum(total);
  std::array<double, residuals::kAlgebraicSums> values{};
  round_sums(total, values);
  return std::bit_cast<Biquadratic>(values);
}

}  // namespace sfmcpp::ba

#include "sfmcpp/ba/bending.hpp"

#include <array>

namespace sfmcpp::ba {

Bending::Bending(const ImageResiduals& images,
                 const linear::ParameterMap& map,
                 const std::vector<int>& free_intrinsics)
    : images_(images),
      map_(map),
      free_intrinsics_(free_intrinsics),
      frames_(images.problem()),
      kernel_(residuals::bending_kernel(images.problem().camera_model)) {}

const std::vector<double>& Bending::along(const optim::State& state,
                                          const linear::Step& step,
                                          std::span<const double> weights) {
  const std::vector<linear::Chunk>& chunks = images_.graph().chunks;
  values_.resize(2 * static_cast<std::size_t>(images_.graph().num_observations()));
  images_.pool().parallel_for(static_cast<int>(chunks.size()),
                              [&](int c) { bend_chunk(state, step, weights, chunks[c]); });
  return values_;
}

void Bending::bend_chunk(const optim::State& state,
                         const linear::Step& step,
                         std::span<const double> weights,
                         const linear::Chunk& chunk) {
  const int tangent = camera_tangent(images_.problem().camera_model);
  std::array<double, linear::kMaxCameraSize> delta{}, intrinsics_step{};
  map_.expand(step.camera.data(), chunk.camera, delta.data());
  Eigen::Vector3d bend = Eigen::Vector3d::Zero();
  if (frames_.any()) {
    const FrameMotion motion = frames_.motion(state, chunk.camera);
    motion.move(delta.data());
    bend = motion.bend(delta.data());
  }
  for (std::size_t k = 0; k < free_intrinsics_.size(); ++k)
    intrinsics_step[free_intrinsics_[k]] = delta[tangent + k];
  residuals::ObservationBatch observations = images_.batch(state, chunk);
  if (!weights.empty()) observations.inverse_sigma = weights.data() + chunk.begin;
  std::array<double, linear::kChunkSize + residuals::kReadAhead> u, v;
  kernel_.bend({.observations = observations,
                .camera_step = delta.data(),
                .camera_bend = bend.data(),
                .intrinsics_step = intrinsics_step.data(),
                .point_steps = step.point.data()},
               u.data(),
               v.data());
  residuals::whiten(images_.shapes(chunk), observations.count, u.data(), v.data());
  double* out = values_.data() + 2L * chunk.begin;
  for (int k = 0; k < observations.count; ++k) {
    out[2L * k] = u[k];
    out[2L * k + 1] = v[k];
  }
}

}  // namespace sfmcpp::ba

#include "sfmcpp/ba/bending.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "sfmcpp/residuals/function_images.hpp"

namespace sfmcpp::ba {
namespace {

using ChunkNumbers = std::array<double, linear::kChunkSize + kReadAhead>;

}  // namespace

Bending::Bending(const ImageResiduals& images,
                 const linear::ParameterMap& map,
                 const std::vector<int>& free_intrinsics,
                 int rows)
    : images_(images),
      map_(map),
      free_intrinsics_(free_intrinsics),
      frames_(images.problem(), sensor_column(images.problem(), free_intrinsics.size())),
      kernel_(residuals::bending_kernel(images.problem().camera_model)),
      num_values_(2 * static_cast<std::size_t>(rows)) {}

std::span<const double> Bending::along(const optim::State& state,
                                       const linear::Step& step,
                                       std::span<const double> weights) {
  values_.resize(num_values_);
  std::fill(values_.begin() + 2L * images_.graph().num_observations(), values_.end(), 0.0);
  if (const CameraFunction* function = images_.problem().camera_model.function()) {
    bend_by_function(*function, state, step, weights);
  } else {
    for_each_batch(state, step, weights, [&](const linear::Chunk& chunk, const auto& batch) {
      bend_by_kernel(batch, chunk);
    });
  }
  return values_;
}

template <class F>
void Bending::for_each_batch(const optim::State& state,
                             const linear::Step& step,
                             std::span<const double> weights,
                             const F& use) const {
  const std::vector<linear::Chunk>& chunks = images_.graph().chunks;
  const int tangent = camera_tangent(images_.problem().camera_model);
  images_.pool().parallel_for(static_cast<int>(chunks.size()), [&](int c) {
    std::array<double, linear::kMaxCameraSize> delta{}, intrinsics_step{};
    map_.expand(step.camera.data(), chunks[c].camera, delta.data());
    Eigen::Vector<double, 6> bend = Eigen::Vector<double, 6>::Zero();
    if (frames_.any()) {
      const FrameMotion motion = frames_.motion(state, chunks[c].camera);
      bend = motion.bend(delta.data());
      motion.move(delta.data());
    }
    for (std::size_t k = 0; k < free_intrinsics_.size(); ++k)
      intrinsics_step[free_intrinsics_[k]] = delta[tangent + k];
    residuals::ObservationBatch observations = images_.batch(state, chunks[c]);
    if (!weights.empty()) observations.inverse_sigma = weights.data() + chunks[c].begin;
    use(chunks[c],
        residuals::BendingBatch{.observations = observations,
                                .camera_step = delta.data(),
                                .camera_bend = bend.data(),
                                .intrinsics_step = intrinsics_step.data(),
                                .point_steps = step.point.data()});
  });
}

void Bending::bend_by_kernel(const residuals::BendingBatch& batch, const linear::Chunk& chunk) {
  ChunkNumbers u, v;
  kernel_.bend(batch, u.data(), v.data());
  write(chunk, u.data(), v.data());
}

// Central second differences, of the images where the step has gone a little way forth and back.
void Bending::bend_by_function(const CameraFunction& function,
                               const optim::State& state,
                               const linear::Step& step,
                               std::span<const double> weights) {
  constexpr double kLength = 1e-2;
  constexpr std::array<double, 3> kLengths{-kLength, 0.0, kLength};
  std::vector<residuals::FunctionImages> images;
  for (const double length : kLengths) {
    images.emplace_back(function, images_.graph().num_observations());
    for_each_batch(state, step, weights, [&](const linear::Chunk& chunk, const auto& batch) {
      images.back().set_along(chunk.begin, batch, length);
    });
    images.back().evaluate(false);
  }
  for_each_batch(state, step, weights, [&](const linear::Chunk& chunk, const auto& batch) {
    std::array<ChunkNumbers, 2> bent;
    for (int k = 0; k < batch.observations.count; ++k) {
      const double scale = batch.observations.inverse_sigma[k] / (kLength * kLength);
      const int observation = chunk.begin + k;
      for (int i = 0; i < 2; ++i) {
        const double second = images[0].pixel(observation)[i] -
                              2.0 * images[1].pixel(observation)[i] +
                              images[2].pixel(observation)[i];
        bent[i][k] = std::isfinite(second) ? scale * second : 0.0;
      }
    }
    write(chunk, bent[0].data(), bent[1].data());
  });
}

void Bending::write(const linear::Chunk& chunk, const double* u, double* v) {
  const int count = chunk.end - chunk.begin;
  residuals::whiten(images_.shapes(chunk), count, u, v);
  double* out = values_.data() + 2L * chunk.begin;
  for (int k = 0; k < count; ++k) {
    out[2L * k] = u[k];
    out[2L * k + 1] = v[k];
  }
}

}  // namespace sfmcpp::ba

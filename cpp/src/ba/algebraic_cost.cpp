#include "sfmcpp/ba/algebraic_cost.hpp"

#include <array>
#include <cmath>

#include "sfmcpp/cameras/visit_camera.hpp"

namespace sfmcpp::ba {
namespace {

// Seen from an image whose observations coincide, every scale is as good.
constexpr double kMinScale = 1e-9;

ImageNormalization normalization_of(const double* u, const double* v, int count) {
  ImageNormalization n;
  if (count == 0) return n;
  for (int k = 0; k < count; ++k) {
    n.centre_u += u[k] / count;
    n.centre_v += v[k] / count;
  }
  double distance = 0.0;
  for (int k = 0; k < count; ++k)
    distance += std::hypot(u[k] - n.centre_u, v[k] - n.centre_v) / count;
  n.scale = std::max(distance / std::sqrt(2.0), kMinScale);
  return n;
}

// N M, with N = diag(1/s, 1/s, 1) · translation by −centre.
void normalize_rows(const ImageNormalization& n, const double* m, double* out) {
  for (int k = 0; k < 4; ++k) {
    out[k] = (m[k] - n.centre_u * m[8 + k]) / n.scale;
    out[4 + k] = (m[4 + k] - n.centre_v * m[8 + k]) / n.scale;
    out[8 + k] = m[8 + k];
  }
}

Biquadratic operator+(const Biquadratic& a, const Biquadratic& b) {
  return {a.aa + b.aa,
          a.ap + b.ap,
          a.aq + b.aq,
          a.pp + b.pp,
          a.qq + b.qq,
          a.pq + b.pq,
          a.pc + b.pc,
          a.qc + b.qc,
          a.cc + b.cc};
}

}  // namespace

AlgebraicCost::AlgebraicCost(const Problem& problem,
                             const linear::ObservationGraph& graph,
                             const linear::ParameterMap& map,
                             const std::vector<int>& free_intrinsics,
                             const std::vector<double>& u,
                             const std::vector<double>& v,
                             ThreadPool& pool)
    : problem_(problem),
      graph_(graph),
      map_(map),
      free_intrinsics_(free_intrinsics),
      u_(u),
      v_(v),
      pool_(pool),
      kernel_(residuals::algebraic_kernel(problem.camera_model)) {}

// Once for all line searches (thesis §4.2.2), and only if there is one.
void AlgebraicCost::normalize_images() {
  if (!normalizations_.empty()) return;
  normalizations_.reserve(static_cast<std::size_t>(graph_.num_cameras));
  for (int i = 0; i < graph_.num_cameras; ++i) {
    const int begin = graph_.camera_begin[i];
    normalizations_.push_back(
        normalization_of(u_.data() + begin, v_.data() + begin, graph_.observations_of_camera(i)));
  }
}

AlgebraicCost::CameraLine AlgebraicCost::camera_line(const optim::State& state,
                                                     const linear::Step& step,
                                                     int camera) const {
  std::array<double, linear::kMaxCameraSize> delta{};
  map_.expand(step.camera.data(), camera, delta.data());
  const int tangent = camera_tangent(problem_.camera_model);
  std::array<double, linear::kMaxCameraSize> intrinsics_delta{};
  for (std::size_t k = 0; k < free_intrinsics_.size(); ++k)
    intrinsics_delta[free_intrinsics_[k]] = delta[tangent + k];
  const double* stored = state.cameras.data() + static_cast<long>(kCameraStorage) * camera;
  const double* intrinsics =
      state.intrinsics.data() +
      static_cast<long>(problem_.num_intrinsics()) * problem_.intrinsics_index[camera];
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
                                 const std::vector<double>& weights,
                                 AlgebraicWeights algebraic_weights) {
  normalize_images();
  std::vector<Biquadratic> sums(graph_.chunks.size());
  pool_.parallel_for(static_cast<int>(sums.size()), [&](int c) {
    const linear::Chunk& chunk = graph_.chunks[c];
    const CameraLine line = camera_line(state, step, chunk.camera);
    const ImageNormalization& n = normalizations_[chunk.camera];
    const long row =
        static_cast<long>(problem_.num_intrinsics()) * problem_.intrinsics_index[chunk.camera];
    sums[c] =
        kernel_.sums({.observations = {.camera = nullptr,
                                       .intrinsics = state.intrinsics.data() + row,
                                       .points = state.points.data(),
                                       .point = graph_.point.data() + chunk.begin,
                                       .u = u_.data() + chunk.begin,
                                       .v = v_.data() + chunk.begin,
                                       .inverse_sigma = weights.data() + chunk.begin,
                                       .count = chunk.end - chunk.begin},
                      .matrix = line.matrix,
                      .change = line.change,
                      .point_steps = step.point.data(),
                      .centre_u = n.centre_u,
                      .centre_v = n.centre_v,
                      .scale = n.scale,
                      .weigh_by_depth = algebraic_weights == AlgebraicWeights::kInverseDepth});
  });
  Biquadratic total;
  for (const Biquadratic& sum : sums) total = total + sum;
  return total;
}

}  // namespace sfmcpp::ba

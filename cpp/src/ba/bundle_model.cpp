#include "sfmcpp/ba/bundle_model.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "sfmcpp/cameras/visit_camera.hpp"

namespace sfmcpp::ba {
namespace {

using linear::Chunk;
using linear::kChunkSize;
using optim::State;
using residuals::kReadAhead;

using ChunkBuffer = std::array<double, kChunkSize + kReadAhead>;

// Values of the caller's observations in stored order, readable beyond the end.
template <class F>
std::vector<double> stored_order(const linear::ObservationGraph& graph, const F& value_of) {
  std::vector<double> values(graph.source.size() + kReadAhead, 1.0);
  for (std::size_t k = 0; k < graph.source.size(); ++k)
    values[k] = value_of(static_cast<std::size_t>(graph.source[k]));
  return values;
}

}  // namespace

optim::State state_of(const Problem& problem) {
  return {.cameras = {problem.cameras.begin(), problem.cameras.end()},
          .intrinsics = {problem.intrinsics.begin(), problem.intrinsics.end()},
          .points = {problem.points.begin(), problem.points.end()}};
}

linear::ObservationGraph graph_of(const Problem& problem) {
  return linear::make_observation_graph(
      problem.num_cameras(), problem.num_points(), problem.camera_index, problem.point_index);
}

BundleModel::BundleModel(const Problem& problem,
                         const linear::ObservationGraph& graph,
                         const linear::ParameterMap& map,
                         std::vector<int> free_intrinsics,
                         ThreadPool& pool,
                         Exchange& exchange)
    : problem_(problem),
      graph_(graph),
      map_(map),
      free_intrinsics_(std::move(free_intrinsics)),
      pool_(pool),
      exchange_(exchange),
      kernels_(residuals::reprojection_kernels(problem.camera_model)),
      u_(stored_order(graph, [&](std::size_t source) { return problem.pixels[2 * source]; })),
      v_(stored_order(graph, [&](std::size_t source) { return problem.pixels[2 * source + 1]; })),
      inverse_sigma_(stored_order(graph,
                                  [&](std::size_t source) {
                                    return problem.sigma_px.empty()
                                               ? 1.0
                                               : 1.0 / problem.sigma_px[source];
                                  })),
      constraints_(problem, map, free_intrinsics_),
      normal_(graph, map, pool, constraints_.pairs(), exchange),
      algebraic_(problem, graph, map, free_intrinsics_, u_, v_, pool) {}

void BundleModel::set_loss(const Loss& loss) {
  loss_ = loss;
  if (loss.kind != LossKind::kSquared) weights_ = inverse_sigma_;
}

residuals::ObservationBatch BundleModel::batch(const State& state, const Chunk& chunk) const {
  const int group = problem_.intrinsics_index[chunk.camera];
  return {
      .camera = state.cameras.data() + static_cast<long>(kCameraStorage) * chunk.camera,
      .intrinsics = state.intrinsics.data() + static_cast<long>(problem_.num_intrinsics()) * group,
      .points = state.points.data(),
      .point = graph_.point.data() + chunk.begin,
      .u = u_.data() + chunk.begin,
      .v = v_.data() + chunk.begin,
      .inverse_sigma = inverse_sigma_.data() + chunk.begin,
      .count = chunk.end - chunk.begin};
}

double BundleModel::chunk_cost(const State& state, const Chunk& chunk) const {
  ChunkBuffer ru, rv;
  kernels_.residuals(batch(state, chunk), ru.data(), rv.data());
  const int count = chunk.end - chunk.begin;
  double sum = 0.0;
  if (loss_.kind == LossKind::kSquared) {
    for (int k = 0; k < count; ++k) sum += ru[k] * ru[k] + rv[k] * rv[k];
  } else {
    for (int k = 0; k < count; ++k) sum += loss_.rho(ru[k] * ru[k] + rv[k] * rv[k]);
  }
  return sum;
}

double BundleModel::cost(const State& state) {
  const auto chunks = static_cast<int>(graph_.chunks.size());
  const double observed =
      0.5 * pool_.sum(chunks, [&](int c) { return chunk_cost(state, graph_.chunks[c]); });
  return observed + constraints_.cost(state);
}

void BundleModel::linearize(const State& state) {
  pool_.parallel_for(static_cast<int>(graph_.chunks.size()),
                     [&](int c) { linearize_chunk(state, c); });
  constraints_.linearize(state, normal_.camera_terms());
  normal_.finish();
}

residuals::JacobianOutput BundleModel::jacobian_output(double* camera, double* point) const {
  return {.free_intrinsics = free_intrinsics_.data(),
          .num_free_intrinsics = static_cast<int>(free_intrinsics_.size()),
          .camera_size = map_.camera_size,
          .camera = camera,
          .point = point};
}

void BundleModel::linearize_chunk(const State& state, int c) {
  const Chunk& chunk = graph_.chunks[c];
  kernels_.linearize(batch(state, chunk),
                     jacobian_output(normal_.camera_jacobian(chunk.begin),
                                     normal_.point_records_from(chunk.begin)));
  if (loss_.kind != LossKind::kSquared) apply_loss(chunk);
  normal_.accumulate(c);
}

// Scaling residual and Jacobian by √ρ′ gives JᵀJ and Jᵀr the weights of the robust cost: its
// gradient is exact, its Hessian the positive part (iteratively reweighted least squares).
void BundleModel::apply_loss(const Chunk& chunk) {
  for (int k = chunk.begin; k < chunk.end; ++k) {
    auto& [row] = normal_.point_record(k);
    const double ru = row[0].residual, rv = row[1].residual;
    const double weight = std::sqrt(loss_.derivative(ru * ru + rv * rv));
    weights_[k] = weight * inverse_sigma_[k];
    double* jacobian = normal_.camera_jacobian(k);
    for (auto& [by_point, residual] : row) {
      for (double& value : by_point) value *= weight;
      residual *= weight;
    }
    for (int e = 0; e < 2 * map_.camera_size; ++e) jacobian[e] *= weight;
  }
}

void BundleModel::plus(const State& state,
                       const linear::Step& step,
                       optim::StepLengths lengths,
                       State& result) const {
  result.intrinsics = state.intrinsics;
  pool_.parallel_for(1 + linear::num_point_tasks(graph_.num_points), [&](int task) {
    if (task == 0) {
      for (int i = 0; i < graph_.num_cameras; ++i)
        move_camera(state, step, lengths.camera, i, result);
    } else {
      const int begin = (task - 1) * linear::kPointsPerTask;
      const int end = std::min(begin + linear::kPointsPerTask, graph_.num_points);
      move_points(state, step, lengths.point, begin, end, result);
    }
  });
}

void BundleModel::move_points(const State& state,
                              const linear::Step& step,
                              double length,
                              int begin,
                              int end,
                              State& result) const {
  visit_camera(problem_.camera_model, [&](auto camera) {
    using Camera = decltype(camera);
    for (long p = begin; p < end; ++p) {
      const double* move = step.point.data() + kPointTangent * p;
      const double delta[kPointTangent] = {length * move[0], length * move[1], length * move[2]};
      const long offset = Camera::kPointStorage * p;
      Camera::plus_point(state.points.data() + offset, delta, result.points.data() + offset);
    }
  });
}

void BundleModel::move_camera(
    const State& state, const linear::Step& step, double length, int camera, State& result) const {
  std::array<double, linear::kMaxCameraSize> delta;
  map_.expand(step.camera.data(), camera, delta.data());
  for (int k = 0; k < map_.camera_size; ++k) delta[k] *= length;
  const long offset = static_cast<long>(kCameraStorage) * camera;
  const double* from = state.cameras.data() + offset;
  double* to = result.cameras.data() + offset;
  const int tangent = camera_tangent(problem_.camera_model);
  if (std::any_of(delta.begin(), delta.begin() + tangent, [](double d) { return d != 0.0; })) {
    plus_camera(problem_.camera_model, from, delta.data(), to);
  } else {
    std::copy_n(from, kCameraStorage, to);
  }
  // Cameras that share a row set it to the same values.
  const long row = static_cast<long>(problem_.num_intrinsics()) * problem_.intrinsics_index[camera];
  for (std::size_t k = 0; k < free_intrinsics_.size(); ++k) {
    if (map_.columns_of(camera)[tangent + k] == linear::kNoColumn) continue;
    const std::size_t parameter = static_cast<std::size_t>(row) + free_intrinsics_[k];
    result.intrinsics[parameter] = state.intrinsics[parameter] + delta[tangent + k];
  }
}

void BundleModel::normalize(State& state) const {
  if (is_metric(problem_.camera_model)) return;
  for (int i = 0; i < graph_.num_cameras; ++i) {
    if (!problem_.fixed_cameras[i])
      normalize_camera(problem_.camera_model,
                       state.cameras.data() + static_cast<long>(kCameraStorage) * i);
  }
  for (int p = 0; p < graph_.num_points; ++p) {
    if (!problem_.fixed_points[p])
      normalize_point(problem_.camera_model,
                      state.points.data() + static_cast<long>(problem_.point_storage()) * p);
  }
}

std::optional<Biquadratic> BundleModel::algebraic_cost(const State& state,
                                                       const linear::Step& step) {
  const bool robust = loss_.kind != LossKind::kSquared;
  return algebraic_.along(state, step, robust ? weights_ : inverse_sigma_, algebraic_weights_);
}

BundleModel::Residuals BundleModel::residuals(const State& state) {
  Residuals result;
  result.values.resize(2 * static_cast<std::size_t>(graph_.num_observations()));
  std::vector<int> behind(graph_.chunks.size());
  pool_.parallel_for(static_cast<int>(graph_.chunks.size()), [&](int c) {
    const Chunk& chunk = graph_.chunks[c];
    ChunkBuffer ru, rv;
    behind[c] = kernels_.residuals(batch(state, chunk), ru.data(), rv.data());
    for (int k = chunk.begin; k < chunk.end; ++k) {
      result.values[2 * static_cast<std::size_t>(k)] = ru[k - chunk.begin];
      result.values[2 * static_cast<std::size_t>(k) + 1] = rv[k - chunk.begin];
    }
  });
  for (int count : behind) result.behind_camera += count;
  return result;
}

}  // namespace sfmcpp::ba

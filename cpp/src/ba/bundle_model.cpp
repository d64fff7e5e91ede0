#include "sfmcpp/ba/bundle_model.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace sfmcpp::ba {
namespace {

using linear::Chunk;
using linear::kChunkSize;
using optim::State;
using residuals::kReadAhead;

using ChunkBuffer = std::array<double, kChunkSize + kReadAhead>;

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
                         ThreadPool& pool)
    : problem_(problem),
      graph_(graph),
      map_(map),
      free_intrinsics_(std::move(free_intrinsics)),
      pool_(pool),
      kernels_(residuals::reprojection_kernels(problem.camera_model)),
      normal_(graph, map, pool) {
  const auto count = static_cast<std::size_t>(graph.num_observations());
  for (auto* values : {&u_, &v_, &inverse_sigma_}) values->assign(count + kReadAhead, 1.0);
  for (std::size_t k = 0; k < count; ++k) {
    const auto source = static_cast<std::size_t>(graph.source[k]);
    u_[k] = problem.pixels[2 * source];
    v_[k] = problem.pixels[2 * source + 1];
    if (!problem.sigma_px.empty()) inverse_sigma_[k] = 1.0 / problem.sigma_px[source];
  }
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
  return 0.5 * pool_.sum(chunks, [&](int c) { return chunk_cost(state, graph_.chunks[c]); });
}

void BundleModel::linearize(const State& state) {
  pool_.parallel_for(static_cast<int>(graph_.chunks.size()),
                     [&](int c) { linearize_chunk(state, c); });
  normal_.finish();
}

void BundleModel::linearize_chunk(const State& state, int c) {
  const Chunk& chunk = graph_.chunks[c];
  kernels_.linearize(batch(state, chunk),
                     {.free_intrinsics = free_intrinsics_.data(),
                      .num_free_intrinsics = static_cast<int>(free_intrinsics_.size()),
                      .camera_size = map_.camera_size,
                      .camera = normal_.camera_jacobian(chunk.begin),
                      .point = normal_.point_record(chunk.begin)});
  if (loss_.kind != LossKind::kSquared) apply_loss(chunk);
  normal_.accumulate(c);
}

// Scaling residual and Jacobian by √ρ′ gives JᵀJ and Jᵀr the weights of the robust cost: its
// gradient is exact, its Hessian the positive part (iteratively reweighted least squares).
void BundleModel::apply_loss(const Chunk& chunk) {
  for (int k = chunk.begin; k < chunk.end; ++k) {
    double* record = normal_.point_record(k);
    const double weight =
        std::sqrt(loss_.derivative(record[3] * record[3] + record[7] * record[7]));
    double* jacobian = normal_.camera_jacobian(k);
    for (int e = 0; e < linear::kPointRecord; ++e) record[e] *= weight;
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
        plus_camera(state, step, lengths.camera, i, result);
      return;
    }
    const std::size_t begin = static_cast<std::size_t>(task - 1) * 3 * linear::kPointsPerTask;
    const std::size_t end = std::min(begin + 3 * linear::kPointsPerTask, state.points.size());
    for (std::size_t k = begin; k < end; ++k)
      result.points[k] = state.points[k] + lengths.point * step.point[k];
  });
}

void BundleModel::plus_camera(
    const State& state, const linear::Step& step, double length, int camera, State& result) const {
  std::array<double, linear::kMaxCameraSize> delta;
  map_.expand(step.camera.data(), camera, delta.data());
  for (int k = 0; k < map_.camera_size; ++k) delta[k] *= length;
  const long offset = static_cast<long>(kCameraStorage) * camera;
  if (std::any_of(delta.begin(), delta.begin() + kPoseTangent, [](double d) { return d != 0.0; })) {
    plus_pose(state.cameras.data() + offset, delta.data(), result.cameras.data() + offset);
  } else {
    std::copy_n(state.cameras.data() + offset, kCameraStorage, result.cameras.data() + offset);
  }
  // Cameras that share a row set it to the same values.
  const long row = static_cast<long>(problem_.num_intrinsics()) * problem_.intrinsics_index[camera];
  for (std::size_t k = 0; k < free_intrinsics_.size(); ++k) {
    if (map_.columns_of(camera)[kPoseTangent + k] == linear::kNoColumn) continue;
    const std::size_t parameter = static_cast<std::size_t>(row) + free_intrinsics_[k];
    result.intrinsics[parameter] = state.intrinsics[parameter] + delta[kPoseTangent + k];
  }
}

std::vector<double> BundleModel::residuals(const State& state) {
  std::vector<double> result(2 * static_cast<std::size_t>(graph_.num_observations()));
  pool_.parallel_for(static_cast<int>(graph_.chunks.size()), [&](int c) {
    const Chunk& chunk = graph_.chunks[c];
    ChunkBuffer ru, rv;
    kernels_.residuals(batch(state, chunk), ru.data(), rv.data());
    for (int k = chunk.begin; k < chunk.end; ++k) {
      result[2 * static_cast<std::size_t>(k)] = ru[k - chunk.begin];
      result[2 * static_cast<std::size_t>(k) + 1] = rv[k - chunk.begin];
    }
  });
  return result;
}

int BundleModel::num_behind_camera(const State& state) {
  int behind = 0;
  for (const Chunk& chunk : graph_.chunks) {
    ChunkBuffer ru, rv;
    behind += kernels_.residuals(batch(state, chunk), ru.data(), rv.data());
  }
  return behind;
}

}  // namespace sfmcpp::ba

#include "sfmcpp/linear/normal_equations.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace sfmcpp::linear {
namespace {

// A parameter that nothing observes still gets a positive damping (the bounds Ceres documents).
constexpr double kMinDiagonal = 1e-6;
constexpr double kMaxDiagonal = 1e32;

// How many observations ahead a record is asked for: the records of a point lie anywhere in memory.
constexpr int kAhead = 12;

// Σ ‖Jc δc + A δp‖² over the observations of a chunk.
double chunk_curvature(const NormalEquations& normal, const Chunk& chunk, const Step& step) {
  const int size = normal.map().camera_size;
  double x[kMaxCameraSize];
  normal.map().expand(step.camera.data(), chunk.camera, x);
  double sum = 0.0;
  for (long a = chunk.begin; a < chunk.end; ++a) {
    const double* point = step.point.data() + 3L * normal.graph().point[a];
    for (int row = 0; row < 2; ++row) {
      const double* j = normal.jacobian() + (2 * a + row) * size;
      const double* record = normal.records() + a * kPointRecord + 4L * row;
      double e = record[0] * point[0] + record[1] * point[1] + record[2] * point[2];
      for (int k = 0; k < size; ++k) e += j[k] * x[k];
      sum += e * e;
    }
  }
  return sum;
}

}  // namespace

double Damping::operator()(double diagonal_entry) const {
  if (matrix == DampingMatrix::kIdentity) return lambda;
  return lambda * std::clamp(diagonal_entry, kMinDiagonal, kMaxDiagonal);
}

NormalEquations::NormalEquations(const ObservationGraph& graph,
                                 const ParameterMap& map,
                                 ThreadPool& pool,
                                 CameraPairs camera_pairs,
                                 Exchange& exchange)
    : graph_(graph),
      map_(map),
      pool_(pool),
      exchange_(exchange),
      kernels_(schur_kernels(map.camera_size)),
      camera_terms_(graph.num_cameras, map.camera_size, std::move(camera_pairs)) {
  const auto observations = static_cast<std::size_t>(graph.num_observations());
  jacobian_.resize(observations * 2 * static_cast<std::size_t>(map.camera_size));
  records_.resize(observations * kPointRecord);
  point_blocks_.resize(static_cast<std::size_t>(graph.num_points) * kPointFactor);
  chunk_sums_.resize(graph.chunks.size() * 2 * static_cast<std::size_t>(map.camera_size));
}

void NormalEquations::accumulate(int chunk) {
  const Chunk& c = graph_.chunks[chunk];
  double* sums = chunk_sums_.data() + 2L * map_.camera_size * chunk;
  std::fill_n(sums, 2 * map_.camera_size, 0.0);
  kernels_.camera_gradient(c.end - c.begin,
                           camera_jacobian(c.begin),
                           point_record(c.begin),
                           sums,
                           sums + map_.camera_size);
}

void NormalEquations::finish() {
  const int size = map_.camera_size;
  camera_rhs_.assign(map_.num_columns, 0.0);
  camera_diagonal_.assign(map_.num_columns, 0.0);
  for (std::size_t chunk = 0; chunk < graph_.chunks.size(); ++chunk) {
    const double* sums = chunk_sums_.data() + 2 * size * chunk;
    map_.fold(sums, graph_.chunks[chunk].camera, camera_rhs_.data());
    map_.fold(sums + size, graph_.chunks[chunk].camera, camera_diagonal_.data());
  }
  camera_terms_.add_rhs(map_, camera_rhs_);
  camera_terms_.add_diagonal(map_, camera_diagonal_);
  for_each_point(pool_, graph_.num_points, [this](int p) { gather_point(p); });

  gradient_max_norm_ = 0.0;
  for (double g : camera_rhs_) gradient_max_norm_ = std::max(gradient_max_norm_, std::abs(g));
  for (int p = 0; p < graph_.num_points; ++p) {
    for (int k = 6; k < 9; ++k)
      gradient_max_norm_ = std::max(gradient_max_norm_, std::abs(point_block(p)[k]));
  }
}

void NormalEquations::gather_point(int p) {
  double block[kPointFactor] = {};
  if (map_.free_point[p]) {
    const auto last = static_cast<int>(graph_.of_point.size()) - 1;
    for (int k = graph_.point_begin[p]; k < graph_.point_begin[p + 1]; ++k) {
      __builtin_prefetch(records_.data() + static_cast<long>(kPointRecord) *
                                               graph_.of_point[std::min(k + kAhead, last)]);
      const double* record = records_.data() + static_cast<long>(kPointRecord) * graph_.of_point[k];
      for (const double* a : {record, record + 4}) {
        block[0] += a[0] * a[0];
        block[1] += a[1] * a[0];
        block[2] += a[1] * a[1];
        block[3] += a[2] * a[0];
        block[4] += a[2] * a[1];
        block[5] += a[2] * a[2];
        for (int c = 0; c < 3; ++c) block[6 + c] += a[c] * a[3];
      }
    }
  }
  std::copy_n(block, kPointFactor, point_blocks_.data() + static_cast<long>(kPointFactor) * p);
}

std::vector<double> NormalEquations::camera_damping(const Damping& damping) const {
  std::vector<double> diagonal(camera_diagonal_.size());
  for (std::size_t k = 0; k < diagonal.size(); ++k) diagonal[k] = damping(camera_diagonal_[k]);
  return diagonal;
}

double NormalEquations::max_diagonal() const {
  double largest = 0.0;
  for (double d : camera_diagonal_) largest = std::max(largest, d);
  for (int p = 0; p < graph_.num_points; ++p) {
    for (int k : {0, 2, 5}) largest = std::max(largest, point_block(p)[k]);
  }
  return largest;
}

Slopes NormalEquations::slopes(const Step& step) const {
  const double camera =
      std::inner_product(camera_rhs_.begin(), camera_rhs_.end(), step.camera.begin(), 0.0);
  double point = 0.0;
  for (int p = 0; p < graph_.num_points; ++p) {
    const double* b = point_block(p) + 6;
    const double* delta = step.point.data() + 3L * p;
    point += b[0] * delta[0] + b[1] * delta[1] + b[2] * delta[2];
  }
  return {-camera, -point};
}

double NormalEquations::curvature(const Step& step) const {
  const double observed = pool_.sum(static_cast<int>(graph_.chunks.size()), [&](int chunk) {
    return chunk_curvature(*this, graph_.chunks[chunk], step);
  });
  return observed + camera_terms_.quadratic_form(map_, step.camera);
}

double NormalEquations::model_decrease(const Step& step) const {
  const Slopes slope = slopes(step);
  return -slope.camera - slope.point - 0.5 * curvature(step);
}

double NormalEquations::predicted_decrease(const Step& step, const Damping& damping) const {
  double sum = 0.0;
  for (std::size_t k = 0; k < camera_rhs_.size(); ++k) {
    sum += step.camera[k] * (camera_rhs_[k] + damping(camera_diagonal_[k]) * step.camera[k]);
  }
  constexpr int kDiagonal[] = {0, 2, 5};
  for (int p = 0; p < graph_.num_points; ++p) {
    const double* block = point_block(p);
    for (int k = 0; k < 3; ++k) {
      const double delta = step.point[3 * static_cast<std::size_t>(p) + k];
      sum += delta * (block[6 + k] + damping(block[kDiagonal[k]]) * delta);
    }
  }
  return 0.5 * sum;
}

}  // namespace sfmcpp::linear

#include "sfmcpp/linear/normal_equations.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/linear/schur_kernels.hpp"
#include "sfmcpp/linear/vector_algebra.hpp"
#include "sfmcpp/math/inverse_factor.hpp"

namespace sfmcpp::linear {
namespace {

// Of unknowns that are held: their steps are a millionth of what they would be by themselves.
constexpr Damping kHeldDamping{1e6, DampingMatrix::kDiagonal};

// How many observations ahead a record is prefetched: the records of a point lie anywhere in
// memory.
constexpr int kAhead = 12;

// Σ ‖Jc δc + A δp‖² over the observations of a chunk.
CompensatedSum chunk_curvature(const NormalEquations& normal,
                               const Chunk& chunk,
                               const Step& step) {
  double x[kMaxCameraSize];
  normal.map().expand(step.camera.data(), chunk.camera, x);
  CompensatedSum sum;
  normal.kernels().curvature(normal.jacobian(),
                             chunk.begin,
                             chunk.end,
                             normal.graph().point.data(),
                             step.point.data(),
                             x,
                             sum);
  return sum;
}

template <class Row>
void add_row(const Row& row, PointBlock& block) {
  const double a[3] = {row.by_point[0], row.by_point[1], row.by_point[2]};
  block.v00 += a[0] * a[0];
  block.v10 += a[1] * a[0];
  block.v11 += a[1] * a[1];
  block.v20 += a[2] * a[0];
  block.v21 += a[2] * a[1];
  block.v22 += a[2] * a[2];
  for (int k = 0; k < 3; ++k) block.rhs[k] += a[k] * row.residual;
}

// The largest f(p) of all points, none of which is negative.
template <class F>
double max_over_points(const NormalEquations& normal, const F& f) {
  const int points = normal.graph().num_points;
  const long part = points_per_task(points);
  const double largest = normal.pool().max(ThreadPool::num_parts(points, part), [&](int task) {
    const long end = std::min<long>((task + 1) * part, points);
    double result = 0.0;
    for (long p = task * part; p < end; ++p) result = std::max(result, f(static_cast<int>(p)));
    return result;
  });
  return normal.exchange().max(largest);
}

// Σ over the points of all ranks, added to `start` by add(p, sum).
template <class F>
double sum_over_points(const NormalEquations& normal, double start, const F& add) {
  const double replicated = normal.exchange().is_root() ? start : 0.0;
  const int points = normal.graph().num_points;
  if (points == 0) return normal.exchange().sum(CompensatedSum(replicated));
  return normal.exchange().sum(
      normal.pool().sum_of_parts(points, kPointsPerSum, [&](long begin, long end) {
        CompensatedSum sum = begin == 0 ? replicated : 0.0;
        for (long p = begin; p < end; ++p) add(static_cast<int>(p), sum);
        return sum;
      }));
}

double largest_magnitude(const double* values, std::size_t count) {
  double largest = 0.0;
  for (std::size_t k = 0; k < count; ++k) largest = std::max(largest, std::abs(values[k]));
  return largest;
}

}  // namespace

SchurKernels schur_kernels(int camera_size, Precision stored) {
  return SFMCPP_FOR_ACTIVE_ISA(kernels_for(camera_size, stored));
}

double Damping::operator()(double diagonal_entry) const {
  if (matrix == DampingMatrix::kIdentity) return lambda;
  return lambda * bounded_diagonal(diagonal_entry);
}

NormalEquations::NormalEquations(const ObservationGraph& graph,
                                 const ParameterMap& map,
                                 ThreadPool& pool,
                                 CameraPairs camera_pairs,
                                 Exchange& exchange,
                                 Precision stored,
                                 bool compensated)
    : graph_(graph),
      map_(map),
      pool_(pool),
      exchange_(exchange),
      compensated_(compensated),
      kernels_(schur_kernels(map.camera_size, stored)),
      camera_terms_(graph.num_cameras, map.camera_size, std::move(camera_pairs)),
      shared_(shared_columns(map)) {
  const auto observations = static_cast<std::size_t>(graph.num_observations());
  if (stored == Precision::kSingle) {
    blocks_.emplace<Blocks<float>>().lost.resize(4 * observations);
    gradients_.resize(static_cast<std::size_t>(graph.num_cameras * gradient_size()));
  }
  std::visit(
      [&](auto& blocks) {
        blocks.jacobian.resize(observations * 2 * static_cast<std::size_t>(map.camera_size));
        blocks.records.resize(observations);
      },
      blocks_);
  point_blocks_.resize(static_cast<std::size_t>(graph.num_points));
  chunk_sums_.resize(graph.chunks.size() * static_cast<std::size_t>(chunk_size()));
}

Precision NormalEquations::precision() const {
  return std::holds_alternative<Blocks<float>>(blocks_) ? Precision::kSingle : Precision::kDouble;
}

StoredJacobian NormalEquations::jacobian() const {
  return std::visit(
      [](const auto& blocks) {
        return StoredJacobian{blocks.jacobian.data(), blocks.records.data()};
      },
      blocks_);
}

const double* NormalEquations::camera_jacobian(int observation) const {
  return std::get<Blocks<double>>(blocks_).jacobian.data() + 2L * map_.camera_size * observation;
}

const PointRecord& NormalEquations::point_record(int observation) const {
  return std::get<Blocks<double>>(blocks_).records[observation];
}

void NormalEquations::start(int chunk) {
  std::fill_n(chunk_sums_.data() + chunk_size() * chunk, chunk_size(), 0.0);
}

NormalEquations::Place NormalEquations::place_of(const Chunk& part, Draft& draft) {
  auto* stored = std::get_if<Blocks<double>>(&blocks_);
  if (stored == nullptr) return {draft.jacobian, draft.records};
  return {stored->jacobian.data() + 2L * map_.camera_size * part.begin,
          stored->records.data() + part.begin};
}

// The gradient is summed before anything is rounded.
void NormalEquations::take(const Chunk& part,
                           const double* jacobian,
                           const PointRecord* records,
                           int chunk) {
  const long size = 2L * map_.camera_size;
  const int count = part.end - part.begin;
  double* sums = chunk_sums_.data() + chunk_size() * chunk;
  (compensated_ ? kernels_.compensated_gradient : kernels_.camera_gradient)(
      count, jacobian, records, sums);
  if (auto* stored = std::get_if<Blocks<float>>(&blocks_)) {
    kernels_.round_jacobian(count, jacobian, stored->jacobian.data() + size * part.begin);
    kernels_.round_records(
        count, records, stored->records.data() + part.begin, stored->lost.data() + 4L * part.begin);
  }
}

void NormalEquations::finish() {
  ++num_linearizations_;
  sum_gradients();
  sum_chunks(0, camera_rhs_);
  sum_chunks(map_.camera_size, camera_diagonal_);
  camera_terms_.add_rhs(map_, camera_rhs_);
  camera_terms_.add_diagonal(map_, camera_diagonal_);
  const double of_points = std::visit(
      [this](const auto& blocks) {
        return max_over_points(*this, [&](int p) {
          point_blocks_[p] = gathered(blocks, p);
          return largest_magnitude(point_block(p).rhs, 3);
        });
      },
      blocks_);
  gradient_max_norm_ =
      std::max(largest_magnitude(camera_rhs_.data(), camera_rhs_.size()), of_points);
}

// Of what lies `first` in the sums of a chunk, over all chunks and ranks.
void NormalEquations::sum_chunks(long first, std::vector<double>& values) {
  values.assign(map_.num_columns, 0.0);
  if (!compensated_) {
    fold_chunks(chunk_sums_.data() + first, chunk_size(), values.data());
    exchange_.sum(values);
    return;
  }
  column_sums_.assign(map_.num_columns, {});
  fold_chunks(chunk_sums_.data() + first, chunk_size(), 2L * map_.camera_size, column_sums_.data());
  exchange_.sum(column_sums_);
  round_sums(column_sums_, values);
}

void NormalEquations::sum_gradients() {
  if (gradients_.empty()) return;
  const long size = map_.camera_size;
  std::ranges::fill(gradients_, 0.0);
  for (std::size_t c = 0; c < graph_.chunks.size(); ++c) {
    const double* of_chunk = chunk_sums_.data() + chunk_size() * static_cast<long>(c);
    double* sum = gradients_.data() + gradient_size() * graph_.chunks[c].camera;
    for (long k = 0; k < size; ++k) {
      if (!compensated_) {
        sum[k] += of_chunk[k];
        continue;
      }
      add_compensated(sum[k], sum[size + k], of_chunk[k]);
      sum[size + k] += of_chunk[2 * size + k];
    }
  }
}

template <class T>
PointBlock NormalEquations::gathered(const Blocks<T>& blocks, int p) const {
  PointBlock block{};
  if (!map_.free_point[p]) return block;
  const auto last = static_cast<int>(graph_.of_point.size()) - 1;
  for (int k = graph_.point_begin[p]; k < graph_.point_begin[p + 1]; ++k) {
    const int ahead = graph_.of_point[std::min(k + kAhead, last)];
    __builtin_prefetch(blocks.records.data() + ahead);
    if (!blocks.lost.empty()) __builtin_prefetch(blocks.lost.data() + 4L * ahead);
    for (const auto& row : blocks.records[graph_.of_point[k]].row) add_row(row, block);
    if (blocks.lost.empty()) continue;
    for (int c = 0; c < 3; ++c) block.rhs[c] += blocks.lost[4L * graph_.of_point[k] + c];
  }
  return block;
}

void NormalEquations::fold_chunks(const double* blocks, long stride, double* reduced) const {
  for_each_camera_in_order([&](int i, Columns columns) {
    for (int chunk = graph_.chunk_begin[i]; chunk < graph_.chunk_begin[i + 1]; ++chunk)
      fold(blocks + stride * chunk, i, columns, reduced);
  });
}

void NormalEquations::fold_chunks(const double* blocks,
                                  long stride,
                                  long rests,
                                  CompensatedSum* reduced) const {
  for_each_camera_in_order([&](int i, Columns columns) {
    for (int chunk = graph_.chunk_begin[i]; chunk < graph_.chunk_begin[i + 1]; ++chunk) {
      const double* sum = blocks + stride * chunk;
      for_each_column(i, columns, [&](int k, int column) {
        reduced[column] += CompensatedSum(sum[k], sum[rests + k]);
      });
    }
  });
}

std::vector<double> NormalEquations::camera_damping(const Damping& damping) const {
  std::vector<double> diagonal;
  get_camera_damping(damping, diagonal);
  return diagonal;
}

void NormalEquations::get_camera_damping(const Damping& damping,
                                         std::vector<double>& diagonal) const {
  diagonal.resize(camera_diagonal_.size());
  for (std::size_t k = 0; k < diagonal.size(); ++k) diagonal[k] = damping_of(k, damping);
}

double NormalEquations::damping_of(std::size_t column, const Damping& damping) const {
  const double entry = camera_diagonal_[column];
  const bool is_held = holds_intrinsics_ && map_.is_intrinsic[column] != 0;
  return is_held ? kHeldDamping(entry) : damping(entry);
}

double NormalEquations::max_diagonal() const {
  const double of_cameras = largest_magnitude(camera_diagonal_.data(), camera_diagonal_.size());
  return std::max(of_cameras, max_over_points(*this, [this](int p) {
                    return std::ranges::max(point_block(p).diagonal());
                  }));
}

Slopes NormalEquations::slopes(const Step& step) const {
  const double point = sum_over_points(*this, 0.0, [&](int p, CompensatedSum& sum) {
    const double* b = point_block(p).rhs;
    const double* delta = step.point.data() + 3L * p;
    sum += b[0] * delta[0] + b[1] * delta[1] + b[2] * delta[2];
  });
  return {-dot(pool_, camera_rhs_, step.camera).value(), -point};
}

double NormalEquations::curvature(const Step& step) const {
  const CompensatedSum observed = pool_.sum(static_cast<int>(graph_.chunks.size()), [&](int chunk) {
    return chunk_curvature(*this, graph_.chunks[chunk], step);
  });
  return exchange_.sum(observed) + camera_terms_.quadratic_form(map_, step.camera);
}

double NormalEquations::model_decrease(const Step& step) const {
  const Slopes slope = slopes(step);
  return -slope.camera - slope.point - 0.5 * curvature(step);
}

double NormalEquations::predicted_decrease(const Step& step, const Damping& damping) const {
  double of_cameras = 0.0;
  for (std::size_t k = 0; k < camera_rhs_.size(); ++k) {
    of_cameras += step.camera[k] * (camera_rhs_[k] + damping_of(k, damping) * step.camera[k]);
  }
  return 0.5 * sum_over_points(*this, of_cameras, [&](int p, CompensatedSum& sum) {
           const PointBlock& block = point_block(p);
           const std::array<double, 3> diagonal = block.diagonal();
           const double* delta = step.point.data() + 3L * p;
           double of_point = 0.0;
           for (int k = 0; k < 3; ++k)
             of_point += delta[k] * (block.rhs[k] + damping(diagonal[k]) * delta[k]);
           sum += of_point;
         });
}

}  // namespace sfmcpp::linear

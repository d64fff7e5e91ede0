#include "sfmcpp/ba/bundle_model.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "sfmcpp/cameras/visit_camera.hpp"
#include "world_motions.hpp"

namespace sfmcpp::ba {
namespace {

using linear::Chunk;
using optim::State;

// Kernels write where the normal equations are stored.
static_assert(linear::kMaxCameraSize <= residuals::kMaxCameraColumns);
static_assert(sizeof(linear::PointRecord) == residuals::kRecordSize * sizeof(double));

double squared_residual(const linear::PointRecord& record) {
  const double ru = record.row[0].residual, rv = record.row[1].residual;
  return ru * ru + rv * rv;
}

// r · J δ of one observation, from its records.
double along(const double* jacobian,
             int camera_size,
             const linear::PointRecord& record,
             const double* camera_step,
             const double* point_step) {
  double sum = 0.0;
  for (int row = 0; row < 2; ++row) {
    double moved = 0.0;
    for (int k = 0; k < camera_size; ++k) moved += jacobian[row * camera_size + k] * camera_step[k];
    const auto& [by_point, residual] = record.row[row];
    for (int k = 0; k < kPointTangent; ++k) moved += by_point[k] * point_step[k];
    sum += residual * moved;
  }
  return sum;
}

std::vector<char> moved_by_images_alone(const linear::ParameterMap& map, const PointRows& rows) {
  std::vector<char> points = map.free_point;
  for (std::size_t p = 0; p < rows.points().size(); ++p) points[p] &= rows.points()[p] == 0;
  return points;
}

}  // namespace

BundleModel::BundleModel(const Problem& problem,
                         const linear::ObservationGraph& graph,
                         PointRows& rows,
                         const linear::ParameterMap& map,
                         std::vector<int> free_intrinsics,
                         ThreadPool& pool,
                         Exchange& exchange,
                         linear::Precision stored,
                         bool compensated)
    : problem_(problem),
      graph_(graph),
      rows_(rows),
      map_(map),
      free_intrinsics_(std::move(free_intrinsics)),
      late_intrinsics_(problem, map, free_intrinsics_),
      frames_(problem, sensor_column(problem, free_intrinsics_.size())),
      pool_(pool),
      exchange_(exchange),
      images_(problem, graph, pool, exchange),
      of_images_alone_(moved_by_images_alone(map, rows)),
      held_(images_, of_images_alone_, compensated),
      refits_(images_, of_images_alone_),
      point_rescues_(images_, of_images_alone_),
      camera_rescues_(images_, map, free_intrinsics_),
      constraints_(problem, map, free_intrinsics_),
      normal_(rows.graph(), map, pool, constraints_.pairs(), exchange, stored, compensated),
      algebraic_(images_, map, free_intrinsics_),
      bending_(images_, map, free_intrinsics_, rows.graph().num_observations()) {}

void BundleModel::set_loss(const Loss& loss) {
  images_.set_loss(loss);
  make_room_for_weights();
}

void BundleModel::let_scale_fall(const State& start, double least) {
  loss_stages_.emplace(images_, point_rescues_, camera_rescues_, start, least);
  make_room_for_weights();
}

void BundleModel::make_room_for_weights() {
  if (images_.is_robust())
    weights_.assign(static_cast<std::size_t>(graph_.num_observations()) + kReadAhead, 1.0);
}

bool BundleModel::moves_intrinsics_far(const State& start, const State& candidate) const {
  return late_intrinsics_.have_moved_far(start, candidate);
}

void BundleModel::hold_intrinsics(bool held) { normal_.hold_intrinsics(held); }

bool BundleModel::sharpen(State& state) { return loss_stages_ && loss_stages_->sharpen(state); }

bool BundleModel::leave(State& state, double cost) {
  return loss_stages_ && loss_stages_->leave(state, cost);
}

bool BundleModel::come_back(State& state) { return loss_stages_ && loss_stages_->come_back(state); }

void BundleModel::keep(optim::Archive& archive) {
  if (loss_stages_) archive.keep(*loss_stages_);
}

double BundleModel::cost(const State& state) {
  return images_.fit(state, held_.at_candidate()).cost + constraints_.cost(state);
}

double BundleModel::growth() const { return held_.growth(); }

long BundleModel::hold_back(const State& start, State& candidate) {
  return images_.single_observations() ? held_.hold_back(start, candidate) : 0;
}

long BundleModel::refit(const State& start,
                        const linear::Step& step,
                        double cost,
                        State& candidate) {
  return images_.single_observations() ? refits_.refit(start, normal_, step, cost, candidate) : 0;
}

double BundleModel::linearize(const State& state) {
  images_.prepare(state);
  fit_ =
      images_.sum_over_chunks([&](int c) { return linearize_chunk(state, c); }, held_.at_start());
  constraints_.linearize(state, rows_, normal_);
  normal_.finish();
  if (modes_wanted_) set_camera_modes(problem_, map_, state, normal_.camera_modes());
  return fit_.cost + constraints_.cost(state);
}

residuals::JacobianOutput BundleModel::jacobian_output(double* camera, double* point) const {
  return {.free_intrinsics = free_intrinsics_.data(),
          .num_free_intrinsics = static_cast<int>(free_intrinsics_.size()),
          .camera_size = map_.camera_size,
          .camera = camera,
          .point = point};
}

// Returns how many points are behind the camera.
int BundleModel::linearize_part(const State& state,
                                const Chunk& part,
                                double* jacobian,
                                linear::PointRecord* records) const {
  const int behind =
      images_.linearize(state, part, jacobian_output(jacobian, records->row[0].by_point));
  if (frames_.any())
    frames_.motion(state, part.camera)
        .carry(jacobian, 2L * (part.end - part.begin), map_.camera_size);
  return behind;
}

ChunkFit BundleModel::linearize_chunk(const State& state, int c) {
  ChunkFit fit;
  residuals::SumOfSquares squares;
  normal_.fill(c, [&](const Chunk& part, double* jacobian, linear::PointRecord* records) {
    fit.behind_camera += linearize_part(state, part, jacobian, records);
    images_.add_squares(part.end - part.begin, records->row[0].by_point, squares);
    if (images_.is_robust()) apply_loss(part, jacobian, records, fit.cost);
  });
  fit.sum_of_squares = squares.total();
  if (!images_.is_robust()) fit.cost = fit.sum_of_squares;
  return fit;
}

// Scaling residual and Jacobian by √ρ′ gives JᵀJ and Jᵀr the weights of the robust cost: its
// gradient is exact, its Hessian the positive part (iteratively reweighted least squares). Adds
// Σ ρ to the cost.
void BundleModel::apply_loss(const Chunk& part,
                             double* jacobian,
                             linear::PointRecord* records,
                             CompensatedSum& cost) {
  const double* inverse_sigma = images_.inverse_sigma(part);
  const int size = 2 * map_.camera_size;
  for (int k = 0; k < part.end - part.begin; ++k) {
    const double squared = squared_residual(records[k]);
    const double weight = std::sqrt(images_.loss().derivative(squared));
    cost += images_.loss().rho(squared);
    weights_[part.begin + k] = weight * inverse_sigma[k];
    for (auto& [by_point, residual] : records[k].row) {
      for (double& value : by_point) value *= weight;
      residual *= weight;
    }
    for (int e = 0; e < size; ++e) jacobian[e + static_cast<long>(size) * k] *= weight;
  }
}

void BundleModel::plus(const State& state,
                       const linear::Step& step,
                       optim::StepLengths lengths,
                       State& result) const {
  result.intrinsics = state.intrinsics;
  result.sensors = state.sensors;
  const int points = graph_.num_points;
  const auto part = static_cast<int>(linear::points_per_task(points));
  const auto move_cameras = [&] {
    for (int i = 0; i < graph_.num_cameras; ++i)
      move_camera(state, step, lengths.camera, i, result);
  };
  pool_.parallel_for_beside(move_cameras, ThreadPool::num_parts(points, part), [&](int task) {
    const int begin = task * part;
    move_points(state, step, lengths.point, begin, std::min(begin + part, points), result);
  });
}

void BundleModel::move_points(const State& state,
                              const linear::Step& step,
                              double length,
                              int begin,
                              int end,
                              State& result) const {
  visit_space(problem_.camera_model, [&](auto space) {
    using Space = decltype(space);
    for (long p = begin; p < end; ++p) {
      const double* move = step.point.data() + kPointTangent * p;
      const double delta[kPointTangent] = {length * move[0], length * move[1], length * move[2]};
      const long offset = Space::kPointStorage * p;
      Space::plus_point(state.points.data() + offset, delta, result.points.data() + offset);
    }
  });
}

void BundleModel::move_camera(
    const State& state, const linear::Step& step, double length, int camera, State& result) const {
  std::array<double, linear::kMaxCameraSize> delta;
  map_.expand(step.camera.data(), camera, delta.data());
  for (int k = 0; k < map_.camera_size; ++k) delta[k] *= length;
  const double* from = state.cameras.data() + problem_.camera_offset(camera);
  double* to = result.cameras.data() + problem_.camera_offset(camera);
  const int tangent = camera_tangent(problem_.camera_model);
  if (frames_.any()) {
    frames_.plus(state, camera, delta.data(), result);
  } else if (std::any_of(
                 delta.begin(), delta.begin() + tangent, [](double d) { return d != 0.0; })) {
    plus_camera(problem_.camera_model, from, delta.data(), to);
  } else {
    std::copy_n(from, kCameraStorage, to);
  }
  // Cameras that share a row set it to the same values.
  const std::size_t row = problem_.intrinsics_offset(camera);
  for (std::size_t k = 0; k < free_intrinsics_.size(); ++k) {
    if (map_.columns_of(camera)[tangent + k] == linear::kNoColumn) continue;
    const std::size_t parameter = row + free_intrinsics_[k];
    result.intrinsics[parameter] = state.intrinsics[parameter] + delta[tangent + k];
  }
}

// Of cameras and points from the first camera: the origin of the world may be far away.
double BundleModel::size(const State& state) const {
  if (!is_metric(problem_.camera_model) || state.cameras.empty())
    return LeastSquaresModel::size(state);
  constexpr long kPart = 4096;
  const PoseMatrixView first(state.cameras.data());
  const Eigen::Vector3d origin = first.col(3);
  double cameras = 0.0;
  for (int i = 0; i < graph_.num_cameras; ++i) {
    const PoseMatrixView pose(state.cameras.data() + problem_.camera_offset(i));
    cameras += pose.leftCols<3>().squaredNorm() + (pose.col(3) - origin).squaredNorm();
  }
  const CompensatedSum points =
      pool_.sum_of_parts(graph_.num_points, kPart, [&](long begin, long end) {
        const Eigen::Map<const Eigen::Matrix3Xd> part(
            state.points.data() + 3 * begin, 3, end - begin);
        return (part.colwise() - origin).squaredNorm();
      });
  return std::sqrt(cameras + linear::squared_norm(pool_, state.intrinsics).value() +
                   exchange_.sum(points));
}

void BundleModel::normalize(State& state) const {
  if (is_metric(problem_.camera_model)) return;
  for (int i = 0; i < graph_.num_cameras; ++i) {
    if (!problem_.is_fixed_camera(i))
      normalize_camera(problem_.camera_model, state.cameras.data() + problem_.camera_offset(i));
  }
  for (int p = 0; p < graph_.num_points; ++p) {
    if (!problem_.is_fixed_point(p))
      normalize_point(problem_.camera_model, state.points.data() + problem_.point_offset(p));
  }
}

double BundleModel::slope(const State& start, const linear::Step& step, const State& candidate) {
  images_.prepare(candidate);
  const linear::Step here{step.camera, transported(start, step, candidate)};
  const CompensatedSum observed = -pool_.sum(static_cast<int>(graph_.chunks.size()), [&](int c) {
    return chunk_slope(candidate, here, c);
  });
  return exchange_.sum(observed) + constraints_.slope(candidate, here);
}

// The points' part of a step as the tangents of `candidate` have it.
std::vector<double> BundleModel::transported(const State& start,
                                             const linear::Step& step,
                                             const State& candidate) const {
  std::vector<double> result(step.point.size());
  visit_space(problem_.camera_model, [&](auto space) {
    using Space = decltype(space);
    for (long p = 0; p < graph_.num_points; ++p) {
      const long offset = Space::kPointStorage * p, tangent = kPointTangent * p;
      Space::transport(start.points.data() + offset,
                       step.point.data() + tangent,
                       candidate.points.data() + offset,
                       result.data() + tangent);
    }
  });
  return result;
}

double BundleModel::chunk_slope(const State& state, const linear::Step& step, int c) const {
  const Chunk& chunk = graph_.chunks[c];
  const int count = chunk.end - chunk.begin, size = map_.camera_size;
  std::vector<double> jacobians(2 * static_cast<std::size_t>(size) * count);
  std::vector<linear::PointRecord> records(count);
  linearize_part(state, chunk, jacobians.data(), records.data());
  std::vector<double> camera_step(size);
  map_.expand(step.camera.data(), chunk.camera, camera_step.data());
  double sum = 0.0;
  for (int k = 0; k < count; ++k) {
    const double weight = images_.loss().derivative(squared_residual(records[k]));
    const long p = graph_.point[chunk.begin + k];
    sum += weight * along(jacobians.data() + 2L * size * k,
                          size,
                          records[k],
                          camera_step.data(),
                          step.point.data() + kPointTangent * p);
  }
  return sum;
}

std::span<const double> BundleModel::bending(const State& state, const linear::Step& step) {
  return bending_.along(state, step, weights());
}

std::span<const double> BundleModel::weights() const {
  return images_.is_robust() ? std::span<const double>(weights_) : std::span<const double>();
}

std::optional<Biquadratic> BundleModel::algebraic_cost(const State& state,
                                                       const linear::Step& step) {
  if (problem_.camera_model.function() != nullptr) return std::nullopt;
  return algebraic_.along(state, step, weights(), algebraic_weights_);
}

}  // namespace sfmcpp::ba

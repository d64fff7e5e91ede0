#include "sfmcpp/ba/camera_rescues.hpp"

#include <algorithm>
#include <limits>

#include <Eigen/Dense>

#include "sfmcpp/ba/point_rescues.hpp"
#include "sfmcpp/optim/damping_rule.hpp"

namespace sfmcpp::ba {
namespace {

using linear::Chunk;
using optim::State;

// The scale begins at so many times the last, and falls after some steps.
constexpr double kWidest = 32.0, kFall = 0.7;
constexpr int kStepsOfScale = 5, kStepsOfLastScale = 20;
// Inliers that a camera must have beyond those that determine its unknowns, which fit anything.
constexpr int kCameraSupport = 3;

constexpr int kMost = linear::kMaxCameraSize;
using Block = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor, kMost, kMost>;
using Column = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMost, 1>;

// The normal equations of a camera, what its views cost, and how many are within the scale: in a
// row of numbers, which ranks and chunks add up.
class Sums {
 public:
  static int room(int size) { return size * size + size + 2; }

  Sums(double* numbers, int size)
      : normal(numbers, size, size),
        gradient(numbers + size * size, size),
        cost(numbers[size * size + size]),
        support(numbers[size * size + size + 1]) {}

  Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> normal;
  Eigen::Map<Eigen::VectorXd> gradient;
  double& cost;
  double& support;
};

class CameraFits {
 public:
  CameraFits(const ImageResiduals& images,
             const linear::ParameterMap& map,
             const std::vector<int>& free_intrinsics)
      : images_(images),
        map_(map),
        free_intrinsics_(free_intrinsics),
        is_shared_(linear::shared_columns(map)) {}

  // Each camera to a minimum of what its views cost.
  std::vector<double> descend(const Loss& loss, int steps, State& state) {
    damping_.assign(static_cast<std::size_t>(images_.graph().num_cameras),
                    {optim::kHartleyStart, linear::DampingMatrix::kDiagonal});
    std::vector<double> now = linearize(loss, state);
    State candidate = state;
    for (int step = 0; step < steps; ++step) {
      for_each_camera([&](int i) { move(i, now, state, candidate); });
      std::vector<double> then = linearize(loss, candidate);
      for_each_camera([&](int i) { take_if_better(i, then, candidate, now, state); });
    }
    return now;
  }

  // Each camera to a minimum under a scale that falls to that of `last`; the sums there.
  std::vector<double> graduate(const Loss& last, State& state) {
    for (double widened = kWidest; widened > 1.0 / kFall; widened *= kFall)
      descend({last.kind, widened * last.scale}, kStepsOfScale, state);
    return descend(last, kStepsOfLastScale, state);
  }

  // Whether a camera costs less by `gain` where the first sums are of, and more views agree there
  // than can be made to.
  bool is_lower(int i, std::vector<double>& found, std::vector<double>& now, double gain) const {
    const Sums there = sums_of(i, found);
    return there.support >= 0.5 * num_unknowns(i) + kCameraSupport &&
           sums_of(i, now).cost - there.cost > gain;
  }

  // Of all cameras, over all ranks.
  std::vector<double> linearize(const Loss& loss, const State& state) const {
    const linear::ObservationGraph& graph = images_.graph();
    std::vector<double> sums(room() * static_cast<std::size_t>(graph.num_cameras));
    for_each_camera([&](int i) {
      Sums of_camera = sums_of(i, sums);
      for (int c = graph.chunk_begin[i]; c < graph.chunk_begin[i + 1]; ++c)
        add(loss, state, graph.chunks[c], of_camera);
    });
    images_.exchange().sum(sums);
    return sums;
  }

  Sums sums_of(int camera, std::vector<double>& sums) const {
    return {sums.data() + room() * static_cast<std::size_t>(camera), map_.camera_size};
  }

  int num_unknowns(int camera) const {
    int count = 0;
    for (int k = 0; k < map_.camera_size; ++k) count += is_own(camera, k);
    return count;
  }

  void copy_sums(int i, const std::vector<double>& from, std::vector<double>& to) const {
    const long begin = static_cast<long>(room()) * i;
    std::copy_n(from.begin() + begin, room(), to.begin() + begin);
  }

  void copy_camera(int i, const State& from, State& to) const {
    const Problem& problem = images_.problem();
    std::copy_n(from.cameras.begin() + static_cast<long>(problem.camera_offset(i)),
                kCameraStorage,
                to.cameras.begin() + static_cast<long>(problem.camera_offset(i)));
    const std::size_t row = problem.intrinsics_offset(i);
    const int tangent = camera_tangent(problem.camera_model);
    for (std::size_t k = 0; k < free_intrinsics_.size(); ++k) {
      if (is_own(i, tangent + static_cast<int>(k)))
        to.intrinsics[row + free_intrinsics_[k]] = from.intrinsics[row + free_intrinsics_[k]];
    }
  }

 private:
  std::size_t room() const { return static_cast<std::size_t>(Sums::room(map_.camera_size)); }

  template <class F>
  void for_each_camera(const F& f) const {
    images_.pool().parallel_for(images_.graph().num_cameras, f);
  }

  // Whether a column of a camera is free, and of no other.
  bool is_own(int camera, int k) const {
    const int column = map_.columns_of(camera)[k];
    return column != linear::kNoColumn && !is_shared_[column];
  }

  void add(const Loss& loss, const State& state, const Chunk& chunk, Sums& sums) const {
    const int count = chunk.end - chunk.begin, size = map_.camera_size;
    std::vector<double> jacobian(2 * static_cast<std::size_t>(size) * count);
    std::vector<double> records(static_cast<std::size_t>(residuals::kRecordSize) * count);
    images_.linearize(state,
                      chunk,
                      {.free_intrinsics = free_intrinsics_.data(),
                       .num_free_intrinsics = static_cast<int>(free_intrinsics_.size()),
                       .camera_size = size,
                       .camera = jacobian.data(),
                       .point = records.data()});
    for (long k = 0; k < count; ++k) {
      const double* record = records.data() + residuals::kRecordSize * k;
      const Eigen::Vector2d residual(record[residuals::kResidualOfU],
                                     record[residuals::kResidualOfV]);
      const Eigen::Map<const Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor>> rows(
          jacobian.data() + 2 * size * k, 2, size);
      const double squared = residual.squaredNorm(), weight = loss.derivative(squared);
      sums.cost += loss.rho(squared);
      sums.support += squared <= loss.scale * loss.scale;
      if (weight == 0.0) continue;
      sums.normal.noalias() += weight * rows.transpose() * rows;
      sums.gradient.noalias() += weight * rows.transpose() * residual;
    }
  }

  // By a damped step (Levenberg–Marquardt) from `state` to `candidate`.
  void move(int i, std::vector<double>& sums, const State& state, State& candidate) const {
    const Sums of_camera = sums_of(i, sums);
    const int size = map_.camera_size;
    Block normal = of_camera.normal;
    Column gradient = of_camera.gradient;
    for (int k = 0; k < size; ++k) {
      normal(k, k) += damping_[i].damping()(normal(k, k));
      if (is_own(i, k) && normal(k, k) > 0.0) continue;
      normal.row(k).setZero();
      normal.col(k).setZero();
      normal(k, k) = 1.0;
      gradient[k] = 0.0;
    }
    const Column delta = normal.llt().solve(gradient);
    if (!delta.allFinite()) return;
    const Problem& problem = images_.problem();
    const std::size_t at = problem.camera_offset(i), row = problem.intrinsics_offset(i);
    const int tangent = camera_tangent(problem.camera_model);
    if (!delta.head(tangent).isZero(0.0))
      plus_camera(problem.camera_model,
                  state.cameras.data() + at,
                  delta.data(),
                  candidate.cameras.data() + at);
    for (std::size_t k = 0; k < free_intrinsics_.size(); ++k) {
      const int column = tangent + static_cast<int>(k);
      const std::size_t parameter = row + free_intrinsics_[k];
      if (is_own(i, column))
        candidate.intrinsics[parameter] = state.intrinsics[parameter] + delta[column];
    }
  }

  void take_if_better(
      int i, std::vector<double>& then, State& candidate, std::vector<double>& now, State& state) {
    if (sums_of(i, then).cost < sums_of(i, now).cost) {
      copy_camera(i, candidate, state);
      copy_sums(i, then, now);
      damping_[i].accepted(1.0);
    } else {
      copy_camera(i, state, candidate);
      damping_[i].rejected();
    }
  }

  const ImageResiduals& images_;
  const linear::ParameterMap& map_;
  const std::vector<int>& free_intrinsics_;
  std::vector<char> is_shared_;
  std::vector<optim::HartleyRule> damping_;  // of each camera
};

}  // namespace

bool CameraRescues::is_possible() const {
  const Problem& problem = images_.problem();
  return is_metric(problem.camera_model) && problem.rigs.empty() && images_.single_observations();
}

long CameraRescues::rescue(const State& start, State& state) const {
  if (!is_possible()) return 0;
  const Loss last = images_.loss();
  const double gain = kLeastRescueGain * last.rho(std::numeric_limits<double>::max());
  CameraFits fits(images_, map_, free_intrinsics_);
  std::vector<double> costs = fits.linearize(last, state);
  std::vector<char> rescued(static_cast<std::size_t>(images_.graph().num_cameras));
  const State here = state;
  for (const State* from : {&here, &start}) {
    State moved = here;
    for (int i = 0; i < images_.graph().num_cameras; ++i) fits.copy_camera(i, *from, moved);
    std::vector<double> found = fits.graduate(last, moved);
    for (int i = 0; i < images_.graph().num_cameras; ++i) {
      if (!fits.is_lower(i, found, costs, gain)) continue;
      fits.copy_camera(i, moved, state);
      fits.copy_sums(i, found, costs);
      rescued[i] = 1;
    }
  }
  return std::ranges::count(rescued, 1);
}

}  // namespace sfmcpp::ba

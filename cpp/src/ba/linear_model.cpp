#include "sfmcpp/ba/linear_model.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include <Eigen/LU>

#include "linear_model_work.hpp"
#include "sfmcpp/ba/rigs.hpp"
#include "sfmcpp/cameras/pose.hpp"
#include "sfmcpp/core/error.hpp"
#include "sfmcpp/core/options_check.hpp"
#include "world_motions.hpp"

namespace sfmcpp::ba {

// A motion of a sensor that nothing determines is spread over all columns, where rounding hides it
// from the factorisation.
void LinearModel::require_sensors() {
  constexpr double kLargest = 1e10;  // inflation
  const int first = sensor_column(problem_, work_->space.intrinsics.size());
  const std::vector<std::vector<int>> cameras = FreeSensors(problem_, work_->space.graph).cameras();
  for (std::size_t s = 0; s < cameras.size(); ++s) {
    for (int k = 0; k < kPoseTangent && !cameras[s].empty(); ++k) {
      const int column = work_->space.map.columns_of(cameras[s].front())[first + k];
      if (column == kNoColumn) continue;
      MatrixXd x = MatrixXd::Zero(work_->space.map.num_columns, 1);
      x(column, 0) = 1.0;
      work_->solver->solve_reduced(x);
      if (x(column, 0) * work_->normal().camera_diagonal()[column] <= kLargest) continue;
      throw InvalidArgument("rigs.sensors[" + std::to_string(s) +
                            "]: its pose in the rig is not determined: the rig must turn about "
                            "more than one axis, or its sensors see points in common");
    }
  }
}

// How the columns answer to the seven similarities, in units of the scene's extent.
MatrixXd LinearModel::motions() const {
  const WorldMotions world(problem_, work_->space.graph, state_);
  MatrixXd result = MatrixXd::Zero(num_columns(), kSimilarities);
  for (int i = 0; i < num_cameras(); ++i) {
    if (work_->space.graph.takes_part(i)) add_camera(world, i, result);
  }
  const std::vector<char> tied = points_tied_to_cameras(problem_, work_->space.graph);
  for (std::size_t k = 0; k < points_.size(); ++k) {
    if (tied[points_[k]])
      result.middleRows<3>(map_.num_columns + 3 * static_cast<Index>(k)) =
          world.extent() * world.of_point(points_[k]);
  }
  return result;
}

// A camera, and the sensor that it is, which answers to the growth of the world if it is free.
void LinearModel::add_camera(const WorldMotions& world, int camera, MatrixXd& motions) const {
  const auto set = [&](int row, const auto& motion) {
    if (const int column = map_.columns_of(camera)[row]; column != kNoColumn)
      motions.row(column) = motion;
  };
  PoseMotion rows = world.of_frame(camera);
  rows.bottomRows<3>() *= world.extent();
  for (int k = 0; k < kPoseTangent; ++k) set(k, rows.row(k));
  if (!world.sensors().camera_moves(camera)) return;
  const int first = sensor_column(problem_, work_->space.intrinsics.size()) + 3;
  const Eigen::RowVectorXd growth = Eigen::RowVectorXd::Unit(kSimilarities, kSimilarities - 1);
  for (int k = 0; k < 3; ++k) set(first + k, world.extent() * world.lever(camera)[k] * growth);
}

// The roots of W, by which poses count whatever the number of points and the unit of the world. One
// camera, or several in one place, tell no size: then all columns count.
VectorXd LinearModel::datum_roots(const MatrixXd& motions) const {
  constexpr double kUnseen = 1e-12;  // of a motion, over what poses see best
  VectorXd ones = VectorXd::Ones(num_columns());
  if (datum_ == Datum::kAll) return ones;
  const double extent = WorldMotions(problem_, work_->space.graph, state_).extent();
  VectorXd roots = VectorXd::Zero(num_columns());
  for (int i = 0; i < num_cameras(); ++i) {
    for_each_column(map_, i, [&](int k, int column) {
      if (k < kPoseTangent) roots[column] = k < 3 ? 1.0 : 1.0 / extent;
    });
  }
  const MatrixXd seen = roots.asDiagonal() * motions;
  const VectorXd sizes = symmetric_spectrum(seen.transpose() * seen).values;
  return sizes[0] > kUnseen * sizes[sizes.size() - 1] ? roots : ones;
}

// Of the motions of the world, those for which the fixed gauge holds columns.
void LinearModel::find_unseen() {
  if (held_.empty()) return;
  const MatrixXd moved = motions() * free_similarities(problem_, work_->space.graph, state_);
  const VectorXd roots = datum_roots(moved);
  const MatrixXd seen = roots.asDiagonal() * moved;
  unseen_ = moved * (orthonormal_columns(seen).transpose() * seen).inverse();
  const MatrixXd weighted = roots.cwiseAbs2().asDiagonal() * unseen_;
  const Index count = unseen_.cols();
  MatrixXd camera = MatrixXd::Zero(work_->space.map.num_columns, count);
  MatrixXd point = MatrixXd::Zero(3L * num_points(), count);
  for (std::size_t c = 0; c < inner_.size(); ++c) {
    if (inner_[c] != kNoColumn) camera.row(inner_[c]) = weighted.row(static_cast<Index>(c));
  }
  for (std::size_t k = 0; k < points_.size(); ++k)
    point.middleRows<3>(3L * points_[k]) =
        weighted.middleRows<3>(map_.num_columns + 3 * static_cast<Index>(k));
  solve_all(camera, point);
  of_unseen_ = assembled(camera, point);
  among_unseen_ = weighted.transpose() * of_unseen_;
}

namespace {

// The held columns make S regular; a linear solver is made where it is needed alone.
SolveOptions inner_options(const Problem& problem, SolveOptions options) {
  options.minimizer.method = optim::Method::kLevenbergMarquardtNielsen;
  options.gauge = is_metric(problem.camera_model) ? Gauge::kFixed : Gauge::kFree;
  options.linear_solver.kind = linear::LinearSolverKind::kIterative;
  options.precision = linear::Precision::kDouble;  // covariances are of J itself
  return options;
}

void add_entries(const linear::ParameterMap& map,
                 int camera,
                 const double* jacobian,
                 int row,
                 std::vector<Eigen::Triplet<double>>& out) {
  for_each_column(map, camera, [&](int k, int column) {
    if (jacobian[k] != 0.0) out.emplace_back(row, column, jacobian[k]);
  });
}

// The loss of errors that lack the weight w of the group: ρ′(w s / c²) = ρ′(s / (c² / w)).
Loss per_unit_weight(const residuals::ConstraintGroup& group) {
  if (!(group.weight > 0.0)) return {};
  Loss loss = group.loss;
  loss.scale /= std::sqrt(group.weight);
  return loss;
}

}  // namespace

LinearModel::LinearModel(const Problem& problem,
                         const SolveOptions& options,
                         double ridge,
                         Datum datum)
    : LinearModel(problem, options, state_of(problem), ridge, datum) {}

LinearModel::LinearModel(const Problem& problem,
                         const SolveOptions& options,
                         const optim::State& state,
                         double ridge,
                         Datum datum)
    : ridge_(ridge), datum_(datum), problem_(problem), state_(state) {
  OptionsCheck check;
  check.require(ridge >= 0.0 && std::isfinite(ridge), "ridge", ridge, "finite and not negative");
  check.done();
  if (problem.constraints != nullptr) constraints_ = *problem.constraints;
  problem_.constraints = &constraints_;
  work_ = std::make_unique<Work>(problem_, inner_options(problem, options), state_);
  Workspace& space = work_->space;
  map_ = options.gauge == Gauge::kFixed
             ? space.map
             : make_parameter_map(problem_, space.graph, space.rows, space.intrinsics);
  residuals_ = space.model.images().values(state_);
  cost_ = space.model.linearize(state_);
  name_columns();
  fill_groups();
}

LinearModel::~LinearModel() = default;

void LinearModel::name_columns() {
  inner_.assign(map_.num_columns, kNoColumn);
  for (int i = 0; i < num_cameras(); ++i) {
    const int* inside = work_->space.map.columns_of(i);
    for_each_column(map_, i, [&](int k, int column) { inner_[column] = inside[k]; });
  }
  for (int c = 0; c < map_.num_columns; ++c) {
    if (inner_[c] == kNoColumn) held_.push_back(c);
  }
  point_place_.assign(num_points(), -1);
  for (int p = 0; p < num_points(); ++p) {
    if (!map_.free_point[p]) continue;
    point_place_[p] = static_cast<int>(points_.size());
    points_.push_back(p);
  }
}

void LinearModel::fill_groups() {
  const ConstraintTerms& constraints = work_->space.model.constraints();
  const int width = work_->space.map.camera_size;
  for (const residuals::ConstraintGroup& group : constraints_.groups()) {
    residuals::ConstraintGroup unweighted = group;
    unweighted.weight = 1.0;
    ConstraintRows rows;
    rows.name = group.name;
    rows.weight = group.weight;
    std::vector<double> errors;
    std::vector<Entry> entries;
    const auto add = [&](std::size_t k, residuals::ConstraintResidual& e) {
      const residuals::ConstraintMember& member = group.members[k];
      residuals::apply_loss(per_unit_weight(group), e);
      for (long row = 0; row < e.rows; ++row) {
        const auto place = static_cast<int>(errors.size());
        if (member.camera != residuals::kNoCamera)
          add_entries(map_, member.camera, e.by_camera.data() + width * row, place, entries);
        if (member.previous != residuals::kNoPrevious)
          add_entries(map_, member.previous, e.by_previous.data() + width * row, place, entries);
        if (member.point != residuals::kNoPoint)
          add_entries_of_point(member.point, e.by_point.data() + 3 * row, place, entries);
        errors.push_back(e.residual[row]);
        rows.member.push_back(static_cast<int>(k));
      }
    };
    constraints.for_each_active(unweighted, state_, add);
    rows.errors = Eigen::Map<const VectorXd>(errors.data(), static_cast<Index>(errors.size()));
    rows.jacobian.resize(rows.errors.size(),
                         residuals::is_on_points(group) ? num_columns() : map_.num_columns);
    rows.jacobian.setFromTriplets(entries.begin(), entries.end());
    groups_.push_back(std::move(rows));
  }
}

void LinearModel::add_entries_of_point(int point,
                                       const double* jacobian,
                                       int row,
                                       std::vector<Entry>& out) const {
  if (point_place_[point] < 0) return;
  for (int k = 0; k < 3; ++k)
    out.emplace_back(row, map_.num_columns + 3 * point_place_[point] + k, jacobian[k]);
}

int LinearModel::num_cameras() const { return problem_.num_cameras(); }
int LinearModel::num_points() const { return static_cast<int>(map_.free_point.size()); }
int LinearModel::num_observations() const { return work_->space.graph.num_observations(); }
double LinearModel::loss_scale() const { return work_->space.model.images().loss().scale; }

int LinearModel::camera_size() const {
  return camera_tangent(problem_.camera_model) + static_cast<int>(work_->space.intrinsics.size()) +
         (has_free_sensors() ? kPoseTangent : 0);
}

std::vector<std::string> LinearModel::free_intrinsics() const {
  std::vector<std::string> names;
  for (int k : work_->space.intrinsics)
    names.emplace_back(intrinsic_names(problem_.camera_model)[k]);
  return names;
}

void LinearModel::camera_columns(int* out) const {
  for (int i = 0; i < num_cameras(); ++i) out = std::copy_n(map_.columns_of(i), camera_size(), out);
}

void LinearModel::point_columns(int* out) const {
  for (int place : point_place_) *out++ = place < 0 ? kNoColumn : map_.num_columns + 3 * place;
}

void LinearModel::residuals(double* out) const {
  for (int a = 0; a < num_observations(); ++a)
    std::copy_n(residuals_.data() + 2L * a, 2, out + 2L * work_->graph().source[a]);
}

void LinearModel::observation_weights(double* out) const {
  for (int a = 0; a < num_observations(); ++a) {
    const double* r = residuals_.data() + 2L * a;
    out[work_->graph().source[a]] =
        work_->space.model.images().loss().derivative(r[0] * r[0] + r[1] * r[1]);
  }
}

void LinearModel::jacobian(double* by_camera, double* by_point) const {
  const int size = camera_size();
  for (int a = 0; a < num_observations(); ++a) {
    const int camera = work_->graph().camera[a];
    const long source = work_->graph().source[a];
    Eigen::Map<RowsByCamera> of_camera(by_camera + 2L * size * source, 2, size);
    of_camera.setZero();
    for_each_column(
        map_, camera, [&](int k, int) { of_camera.col(k) = -work_->by_camera(a).col(k); });
    Eigen::Map<RowsByPoint> of_point(by_point + 6 * source);
    of_point = point_place_[work_->graph().point[a]] < 0 ? RowsByPoint(RowsByPoint::Zero())
                                                         : RowsByPoint(-work_->by_point(a));
  }
}

LinearStep LinearModel::step() {
  factorize();
  const linear::NormalEquations& normal = work_->normal();
  LinearStep step;
  const linear::Slopes slopes = normal.slopes(step_);
  step.decrease = -0.5 * (slopes.camera + slopes.point);
  VectorXd moved = VectorXd::Zero(num_columns());
  for (std::size_t c = 0; c < inner_.size(); ++c) {
    if (inner_[c] != kNoColumn) moved[static_cast<Index>(c)] = step_.camera[inner_[c]];
  }
  for (std::size_t k = 0; k < points_.size(); ++k)
    moved.segment<3>(map_.num_columns + 3 * static_cast<Index>(k)) =
        Eigen::Map<const Eigen::Vector3d>(step_.point.data() + 3L * points_[k]);
  for (const ConstraintRows& group : groups_)
    step.errors.emplace_back(group.errors + group.jacobian * moved.head(group.jacobian.cols()));
  step.state = state_;
  work_->space.model.plus(state_, step_, {}, step.state);
  return step;
}

}  // namespace sfmcpp::ba

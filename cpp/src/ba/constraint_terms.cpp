#include "sfmcpp/ba/constraint_terms.hpp"

#include <array>
#include <optional>
#include <utility>

#include "sfmcpp/core/error.hpp"

namespace sfmcpp::ba {
namespace {

using residuals::ConstrainedCameras;
using residuals::ConstraintGroup;
using residuals::ConstraintMember;
using residuals::ConstraintResidual;
using residuals::ConstraintSet;
using residuals::kNoPrevious;

// Calls f(group, position of the member, member).
template <class F>
void for_each_member(const ConstraintSet* constraints, const F& f) {
  if (constraints == nullptr) return;
  for (const ConstraintGroup& group : constraints->groups()) {
    for (std::size_t k = 0; k < group.members.size(); ++k) f(group, k, group.members[k]);
  }
}

// The first of these intrinsic parameters that a camera keeps fixed, or none.
std::optional<int> fixed_parameter(const Problem& problem,
                                   const std::vector<int>& indices,
                                   int camera) {
  for (int k : indices) {
    if (problem.is_fixed_intrinsic(problem.intrinsics_offset(camera) + k)) return k;
  }
  return std::nullopt;
}

void check_intrinsics_free(const Problem& problem,
                           const ConstraintGroup& group,
                           std::size_t k,
                           const ConstraintMember& member) {
  const auto indices = residuals::constrained_intrinsics(group.kind, problem.camera_model);
  const auto fixed = fixed_parameter(problem, indices, member.camera);
  if (!fixed) return;
  if (member.previous != kNoPrevious && !fixed_parameter(problem, indices, member.previous)) return;
  throw InvalidArgument(residuals::name_of(group, k) + ": camera " + std::to_string(member.camera) +
                        " keeps its " + std::string(intrinsic_names(problem.camera_model)[*fixed]) +
                        " fixed: a constraint on intrinsics needs them free");
}

// J δ, added to `moved`; of one camera below.
void add_product(const std::vector<double>& jacobian, const double* x, std::vector<double>& moved) {
  const std::size_t size = jacobian.size() / moved.size();
  for (std::size_t row = 0; row < moved.size(); ++row) {
    for (std::size_t k = 0; k < size; ++k) moved[row] += jacobian[size * row + k] * x[k];
  }
}

void add_product(const std::vector<double>& jacobian,
                 const linear::ParameterMap& map,
                 const std::vector<double>& step,
                 int camera,
                 std::vector<double>& moved) {
  std::array<double, linear::kMaxCameraSize> x;
  map.expand(step.data(), camera, x.data());
  add_product(jacobian, x.data(), moved);
}

}  // namespace

ConstrainedCameras constrained_cameras(const Problem& problem, const optim::State& state) {
  return {.camera_model = problem.camera_model,
          .count = problem.num_cameras(),
          .cameras = state.cameras.data(),
          .intrinsics = state.intrinsics.data(),
          .intrinsics_index = problem.intrinsics_index.data(),
          .num_points = problem.num_points(),
          .points = state.points.data()};
}

std::vector<char> points_tied_to_cameras(const Problem& problem,
                                         const linear::ObservationGraph& images) {
  std::vector<char> tied(static_cast<std::size_t>(images.num_points));
  for (int p = 0; p < images.num_points; ++p) tied[p] = images.observations_of_point(p) > 0;
  for_each_member(
      problem.constraints,
      [&](const ConstraintGroup&, std::size_t, const ConstraintMember& member) {
        if (member.point != residuals::kNoPoint && member.camera != residuals::kNoCamera)
          tied[member.point] = 1;
      });
  return tied;
}

void check_constraints(const Problem& problem, const optim::State& state) {
  if (problem.constraints == nullptr) return;
  problem.constraints->check(constrained_cameras(problem, state));
  for_each_member(problem.constraints,
                  [&](const ConstraintGroup& group, std::size_t k, const ConstraintMember& member) {
                    check_intrinsics_free(problem, group, k, member);
                  });
}

ConstraintTerms::ConstraintTerms(const Problem& problem,
                                 const linear::ParameterMap& map,
                                 const std::vector<int>& free_intrinsics)
    : problem_(problem),
      map_(map),
      frames_(problem, sensor_column(problem, free_intrinsics.size())) {
  columns_.width = map.camera_size;
  columns_.of_intrinsics.assign(problem.num_intrinsics(), residuals::ConstraintColumns::kNone);
  for (std::size_t k = 0; k < free_intrinsics.size(); ++k)
    columns_.of_intrinsics[free_intrinsics[k]] =
        camera_tangent(problem.camera_model) + static_cast<int>(k);
  for_each_member(problem.constraints,
                  [&](const ConstraintGroup& group, std::size_t, const ConstraintMember& member) {
                    if (residuals::is_active(group, member)) active_.push_back({&group, &member});
                  });
}

linear::CameraPairs ConstraintTerms::pairs() const {
  linear::CameraPairs pairs;
  for (const auto& [group, member] : active_) {
    if (member->point != residuals::kNoPoint) continue;
    pairs.emplace_back(member->camera,
                       member->previous == kNoPrevious ? member->camera : member->previous);
  }
  return pairs;
}

long ConstraintTerms::num_equations() const {
  long count = 0;
  for (const auto& [group, member] : active_) count += residuals::num_equations(*group, *member);
  return count;
}

double ConstraintTerms::cost(const optim::State& state) const {
  if (active_.empty()) return 0.0;
  return problem_.constraints->cost(constrained_cameras(problem_, state));
}

std::vector<double> ConstraintTerms::costs(const optim::State& state) const {
  if (problem_.constraints == nullptr) return {};
  return problem_.constraints->costs(constrained_cameras(problem_, state));
}

void ConstraintTerms::for_each_active(
    const ConstraintGroup& group,
    const optim::State& state,
    const std::function<void(std::size_t, ConstraintResidual&)>& visit) const {
  const ConstrainedCameras cameras = constrained_cameras(problem_, state);
  const auto carry = [&](int camera, int rows, std::vector<double>& jacobian) {
    if (frames_.any() && camera != kNoPrevious)
      frames_.motion(state, camera).carry(jacobian.data(), rows, columns_.width);
  };
  residuals::evaluate_all(group, cameras, &columns_, [&](std::size_t k, ConstraintResidual& e) {
    carry(group.members[k].camera, e.rows, e.by_camera);
    carry(group.members[k].previous, e.rows, e.by_previous);
    visit(k, e);
  });
}

void ConstraintTerms::for_each_weighted(
    const optim::State& state,
    const std::function<void(const ConstraintGroup&, std::size_t, ConstraintResidual&)>& visit)
    const {
  if (active_.empty()) return;
  for (const ConstraintGroup& group : problem_.constraints->groups()) {
    for_each_active(group, state, [&](std::size_t k, ConstraintResidual& e) {
      residuals::apply_loss(group.loss, e);
      visit(group, k, e);
    });
  }
}

void ConstraintTerms::linearize(const optim::State& state,
                                PointRows& rows,
                                linear::NormalEquations& normal) const {
  normal.camera_terms().set_zero();
  rows.start(map_.camera_size);
  for_each_weighted(state, [&](const ConstraintGroup& group, std::size_t k, ConstraintResidual& e) {
    for (double& value : e.residual) value = -value;  // e + J δ is −(r − J δ)
    const ConstraintMember& member = group.members[k];
    if (member.point != residuals::kNoPoint) return rows.set(group, k, e);
    const bool two = member.previous != kNoPrevious;
    normal.camera_terms().add({.rows = e.rows,
                               .residual = e.residual.data(),
                               .camera = member.camera,
                               .by_camera = e.by_camera.data(),
                               .other = two ? member.previous : linear::kNoCamera,
                               .by_other = two ? e.by_previous.data() : nullptr});
  });
  rows.fill(normal);
}

double ConstraintTerms::slope(const optim::State& state, const linear::Step& step) const {
  double sum = 0.0;
  for_each_weighted(state, [&](const ConstraintGroup& group, std::size_t k, ConstraintResidual& e) {
    const ConstraintMember& member = group.members[k];
    std::vector<double> moved(e.rows, 0.0);
    for (const auto& [camera, jacobian] :
         {std::pair(member.camera, &e.by_camera), std::pair(member.previous, &e.by_previous)}) {
      if (camera != residuals::kNoCamera) add_product(*jacobian, map_, step.camera, camera, moved);
    }
    if (member.point != residuals::kNoPoint)
      add_product(e.by_point, step.point.data() + long{kPointTangent} * member.point, moved);
    for (int row = 0; row < e.rows; ++row) sum += e.residual[row] * moved[row];
  });
  return sum;
}

}  // namespace sfmcpp::ba

#include "sfmcpp/residuals/constraint_set.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "sfmcpp/cameras/pose.hpp"

namespace sfmcpp::residuals {
namespace {

double* resized(std::vector<double>& values, long size) {
  values.assign(static_cast<std::size_t>(size), 0.0);
  return values.data();
}

void scale(double factor, std::vector<double>& values) {
  for (double& value : values) value *= factor;
}

// Each of the rows of a residual or of a Jacobian.
void scale_rows(std::span<const double> factors, std::vector<double>& values) {
  const std::size_t width = values.size() / factors.size();
  for (std::size_t i = 0; i < values.size(); ++i) values[i] *= factors[i / width];
}

void apply_weights(const ConstraintGroup& group,
                   const ConstraintMember& member,
                   ConstraintResidual& e) {
  const double factor = std::sqrt(group.weight * member.weight);
  for (std::vector<double>* values : {&e.residual, &e.by_camera, &e.by_previous}) {
    scale(factor, *values);
  }
  if (member.entry_weights.empty()) return;
  std::vector<double> roots(member.entry_weights.size());
  std::ranges::transform(
      member.entry_weights, roots.begin(), [](double weight) { return std::sqrt(weight); });
  for (std::vector<double>* values : {&e.residual, &e.by_camera, &e.by_previous}) {
    scale_rows(roots, *values);
  }
}

// rows × 6 → rows × D, the other columns zero.
void widen(int rows, int width, std::vector<double>& jacobian) {
  if (width == kPoseTangent) return;
  std::vector<double> wide(static_cast<std::size_t>(rows) * width, 0.0);
  for (long row = 0; row < rows; ++row)
    std::copy_n(jacobian.begin() + kPoseTangent * row, kPoseTangent, wide.begin() + width * row);
  jacobian = std::move(wide);
}

void evaluate_pose(const ConstraintMember& member,
                   const ConstrainedCameras& cameras,
                   const ConstraintColumns* columns,
                   ConstraintResidual& out) {
  const PoseConstraint constraint = measurement_of(member);
  const bool two = member.previous != kNoPrevious;
  out.rows = residual_size(constraint);
  ConstraintOutput output{.residual = resized(out.residual, out.rows)};
  if (columns != nullptr) {
    output.by_pose = resized(out.by_camera, 6L * out.rows);
    if (two) output.by_previous = resized(out.by_previous, 6L * out.rows);
  }
  evaluate(constraint,
           cameras.pose(member.camera),
           two ? cameras.pose(member.previous) : nullptr,
           output);
  if (columns == nullptr) return;
  widen(out.rows, columns->width, out.by_camera);
  if (two) widen(out.rows, columns->width, out.by_previous);
}

std::array<double, 2> parameters(const ConstrainedCameras& cameras,
                                 int camera,
                                 const std::vector<int>& indices) {
  std::array<double, 2> values{};
  for (std::size_t k = 0; k < indices.size(); ++k)
    values[k] = cameras.intrinsics_of(camera)[indices[k]];
  return values;
}

// A multiple of the identity in the columns of the parameters.
void place(double value,
           const std::vector<int>& indices,
           const ConstraintColumns& columns,
           std::vector<double>& jacobian) {
  resized(jacobian, static_cast<long>(columns.width) * static_cast<long>(indices.size()));
  for (std::size_t row = 0; row < indices.size(); ++row) {
    const int column = columns.of_intrinsics[indices[row]];
    if (column != ConstraintColumns::kNone) jacobian[columns.width * row + column] = value;
  }
}

void evaluate_intrinsics(ConstraintKind kind,
                         const ConstraintMember& member,
                         const ConstrainedCameras& cameras,
                         const ConstraintColumns* columns,
                         ConstraintResidual& out) {
  const std::vector<int> indices = constrained_intrinsics(kind, cameras.camera_model);
  const bool two = member.previous != kNoPrevious;
  const auto values = parameters(cameras, member.camera, indices);
  const auto reference = two ? parameters(cameras, member.previous, indices) : member.intrinsics;
  const IntrinsicsResidual e = evaluate(kind, values.data(), reference.data());
  out.rows = facts_of(kind).entries;
  out.residual.assign(e.residual.begin(), e.residual.begin() + out.rows);
  if (columns == nullptr) return;
  place(e.by_values, indices, *columns, out.by_camera);
  if (two) place(e.by_reference, indices, *columns, out.by_previous);
}

double group_cost(const ConstraintGroup& group, const ConstrainedCameras& cameras) {
  double sum = 0.0;
  evaluate_all(group, cameras, nullptr, [&](std::size_t, const ConstraintResidual& e) {
    sum += group.loss.rho(squared_error(e));
  });
  return 0.5 * sum;
}

bool has_previous(const ConstraintGroup& group) {
  return !group.members.empty() && group.members[0].previous != kNoPrevious;
}

std::vector<double> poses_of(const ConstraintGroup& group, const ConstrainedCameras& cameras) {
  std::vector<double> poses;
  poses.reserve(2UL * kCameraStorage * group.members.size());
  for (const ConstraintMember& member : group.members) {
    for (int camera : {member.previous, member.camera}) {
      if (camera == kNoPrevious) continue;
      poses.insert(poses.end(), cameras.pose(camera), cameras.pose(camera) + kCameraStorage);
    }
  }
  return poses;
}

// Row by row, the columns of `pose` among those of all.
void take_columns(
    const double* jacobian, int rows, int poses, int pose, std::vector<double>& result) {
  double* out = resized(result, 1L * kPoseTangent * rows);
  for (long row = 0; row < rows; ++row) {
    std::copy_n(
        jacobian + kPoseTangent * (poses * row + pose), kPoseTangent, out + kPoseTangent * row);
  }
}

void evaluate_function(const ConstraintGroup& group,
                       const ConstrainedCameras& cameras,
                       const ConstraintColumns* columns,
                       const ResidualVisitor& visit) {
  const int rows = group.function->rows(), poses = has_previous(group) ? 2 : 1;
  const long size = static_cast<long>(rows) * poses * kPoseTangent;
  std::vector<double> residuals(group.members.size() * rows);
  std::vector<double> jacobian(columns == nullptr ? 0 : group.members.size() * size);
  group.function->evaluate(poses_of(group, cameras).data(),
                           residuals.data(),
                           columns == nullptr ? nullptr : jacobian.data());
  ConstraintResidual e{.rows = rows, .residual = {}, .by_camera = {}, .by_previous = {}};
  for (std::size_t k = 0; k < group.members.size(); ++k) {
    if (!is_active(group, group.members[k])) continue;
    e.residual.assign(residuals.begin() + rows * k, residuals.begin() + rows * (k + 1));
    if (columns != nullptr) {
      take_columns(jacobian.data() + size * k, rows, poses, poses - 1, e.by_camera);
      widen(rows, columns->width, e.by_camera);
      if (poses == 2) {
        take_columns(jacobian.data() + size * k, rows, poses, 0, e.by_previous);
        widen(rows, columns->width, e.by_previous);
      }
    }
    apply_weights(group, group.members[k], e);
    visit(k, e);
  }
}

[[noreturn]] void refuse(const std::string& name, const std::string& rule) {
  throw InvalidArgument(name + ": " + rule);
}

std::string kind_text(const ConstraintGroup& group) {
  return "kind '" + std::string(enum_name(group.kind)) + "'";
}

void check_weight(const std::string& name, double weight) {
  if (weight >= 0.0 && std::isfinite(weight)) return;
  refuse(name + " = " + std::to_string(weight), "must be finite and not negative");
}

void check_previous(const ConstraintGroup& group, std::size_t k) {
  const ConstraintMember& member = group.members[k];
  const bool has_previous = member.previous != kNoPrevious;
  const CamerasOfMember wanted =
      group.function ? CamerasOfMember::kOneOrTwo : facts_of(group.kind).cameras;
  if (wanted != CamerasOfMember::kOneOrTwo && (wanted == CamerasOfMember::kTwo) != has_previous) {
    refuse(name_of(group, k),
           kind_text(group) + " is on " +
               (has_previous ? "one camera, two are given" : "two cameras, one is given"));
  }
  if (has_previous && member.previous == member.camera) {
    refuse(name_of(group, k) + ".cameras",
           "camera " + std::to_string(member.camera) + " twice: must be two different ones");
  }
}

void check_intrinsics_measurement(const ConstraintGroup& group, std::size_t k) {
  const ConstraintMember& member = group.members[k];
  if (member.previous != kNoPrevious) return;
  const int size = facts_of(group.kind).entries;
  for (int c = 0; c < size; ++c) {
    if (!std::isfinite(member.intrinsics[c])) refuse(name_of(group, k), "must be finite");
  }
  if (size == 1 && !(member.intrinsics[0] > 0.0)) {
    refuse(name_of(group, k) + " = " + std::to_string(member.intrinsics[0]),
           "a focal length must be positive");
  }
}

void check_camera(const std::string& name, int camera, int count) {
  if (camera >= 0 && camera < count) return;
  refuse(name + ".cameras",
         "camera " + std::to_string(camera) + ": must be in [0, " + std::to_string(count) + ")");
}

void check_in_front(const std::string& name,
                    const double* pose,
                    const std::vector<double>& points) {
  for (std::size_t k = 0; k < points.size(); k += 3) {
    double depth = 0.0;
    for (int row = 0; row < 3; ++row)
      depth += pose[4 * row + 2] * (points[k + row] - pose[4 * row + 3]);
    if (!(depth > 0.0)) {
      refuse(name + ".points[" + std::to_string(k / 3) + "]",
             "depth " + std::to_string(depth) + ": must be in front of the camera");
    }
  }
}

void check_frozen_points(const ConstraintGroup& group,
                         std::size_t k,
                         const ConstrainedCameras& cameras) {
  const ConstraintMember& member = group.members[k];
  check_in_front(name_of(group, k), cameras.pose(member.camera), member.points);
  if (member.previous != kNoPrevious) {
    check_in_front(name_of(group, k), cameras.pose(member.previous), member.points);
    return;
  }
  std::array<double, kCameraStorage> measured;
  for (int row = 0; row < 3; ++row) {
    for (int c = 0; c < 3; ++c) measured[4 * row + c] = member.pose.rotation(row, c);
    measured[4 * row + 3] = cameras.pose(member.camera)[4 * row + 3];
  }
  check_in_front(name_of(group, k), measured.data(), member.points);
}

void check_intrinsics(const ConstraintGroup& group,
                      std::size_t k,
                      const ConstrainedCameras& cameras) {
  const ConstraintMember& member = group.members[k];
  const int wanted = facts_of(group.kind).entries;
  const auto indices = constrained_intrinsics(group.kind, cameras.camera_model);
  if (!has_free_intrinsics(cameras.camera_model) || static_cast<int>(indices.size()) < wanted) {
    refuse(name_of(group, k),
           kind_text(group) + ": camera model '" + std::string(enum_name(cameras.camera_model)) +
               "' has no such free parameter");
  }
  for (int camera : {member.camera, member.previous}) {
    if (camera == kNoPrevious || wanted != 1) continue;
    const double focal = cameras.intrinsics_of(camera)[indices[0]];
    if (!(focal > 0.0)) {
      refuse(name_of(group, k),
             "camera " + std::to_string(camera) + " has f = " + std::to_string(focal) +
                 ": its logarithm is constrained, it must be positive");
    }
  }
  if (member.previous == kNoPrevious) return;
  if (cameras.intrinsics_index[member.camera] == cameras.intrinsics_index[member.previous]) {
    refuse(name_of(group, k) + ".cameras",
           "cameras " + std::to_string(member.previous) + " and " + std::to_string(member.camera) +
               " share their intrinsics: there is nothing to compare");
  }
}

void check_group(const ConstraintGroup& group) {
  if (group.name.empty()) refuse("constraints", "a group has an empty name");
  check_weight("constraints['" + group.name + "'].weight", group.weight);
  if (!is_loss_scale(group.loss.scale)) {
    std::string rule = "must be ";
    rule += kLossScaleRule;
    refuse("constraints['" + group.name + "'].loss_scale = " + std::to_string(group.loss.scale),
           rule);
  }
  if (group.loss.kind == LossKind::kAuto) {
    refuse("constraints['" + group.name + "'].loss = 'auto'",
           "its scale is told by the residuals of observations; choose another");
  }
  for (std::size_t k = 0; k < group.members.size(); ++k) {
    const ConstraintMember& member = group.members[k];
    check_weight(name_of(group, k) + ".weight", member.weight);
    for (double weight : member.entry_weights) check_weight(name_of(group, k) + ".weight", weight);
    check_previous(group, k);
    if (group.function) continue;
    if (facts_of(group.kind).is_on_poses()) {
      validate(measurement_of(member), name_of(group, k));
    } else {
      check_intrinsics_measurement(group, k);
    }
  }
}

void check_member(const ConstraintGroup& group, std::size_t k, const ConstrainedCameras& cameras) {
  const ConstraintMember& member = group.members[k];
  if (!is_metric(cameras.camera_model)) {
    refuse("constraints['" + group.name + "']",
           "camera_model = '" + std::string(enum_name(cameras.camera_model)) +
               "': constraints are on poses and focal lengths of metric cameras");
  }
  check_camera(name_of(group, k), member.camera, cameras.count);
  if (member.previous != kNoPrevious)
    check_camera(name_of(group, k), member.previous, cameras.count);
  if (group.function) return;
  if (!facts_of(group.kind).is_on_poses()) check_intrinsics(group, k, cameras);
  if (facts_of(group.kind).compares_images()) check_frozen_points(group, k, cameras);
}

}  // namespace

void ConstraintSet::add(ConstraintGroup group) {
  for (const ConstraintGroup& other : groups_) {
    if (other.name == group.name)
      throw InvalidArgument("constraints['" + group.name + "']: two groups have this name");
  }
  for (ConstraintMember& member : group.members) {
    member.pose.kind = group.kind;
    member.pose.points = {};
  }
  check_group(group);
  groups_.push_back(std::move(group));
}

void ConstraintSet::set_weight(std::string_view name, double weight) {
  const auto group = std::find_if(
      groups_.begin(), groups_.end(), [&](const ConstraintGroup& g) { return g.name == name; });
  if (group == groups_.end())
    throw InvalidArgument("constraints['" + std::string(name) + "']: no group has this name");
  check_weight("constraints['" + group->name + "'].weight", weight);
  group->weight = weight;
}

void ConstraintSet::check(const ConstrainedCameras& cameras) const {
  for (const ConstraintGroup& group : groups_) {
    for (std::size_t k = 0; k < group.members.size(); ++k) check_member(group, k, cameras);
  }
}

std::vector<double> ConstraintSet::costs(const ConstrainedCameras& cameras) const {
  std::vector<double> costs;
  costs.reserve(groups_.size());
  for (const ConstraintGroup& group : groups_) costs.push_back(group_cost(group, cameras));
  return costs;
}

double ConstraintSet::cost(const ConstrainedCameras& cameras) const {
  const std::vector<double> each = costs(cameras);
  return std::accumulate(each.begin(), each.end(), 0.0);
}

bool is_active(const ConstraintGroup& group, const ConstraintMember& member) {
  return group.weight > 0.0 && member.weight > 0.0;
}

std::string name_of(const ConstraintGroup& group, std::size_t member) {
  return "constraints['" + group.name + "'][" + std::to_string(member) + "]";
}

const double* ConstrainedCameras::intrinsics_of(int i) const {
  return intrinsics + static_cast<long>(intrinsic_names(camera_model).size()) * intrinsics_index[i];
}

PoseConstraint measurement_of(const ConstraintMember& member) {
  PoseConstraint constraint = member.pose;
  constraint.points = member.points;
  return constraint;
}

std::vector<int> constrained_intrinsics(ConstraintKind kind, CameraModelId model) {
  const auto& wanted = facts_of(kind).parameters;
  const auto names = intrinsic_names(model);
  std::vector<int> indices;
  for (int k = 0; k < static_cast<int>(names.size()); ++k) {
    if (std::ranges::find(wanted, names[k]) != wanted.end()) indices.push_back(k);
  }
  return indices;
}

bool is_on_poses(const ConstraintGroup& group) {
  return group.function != nullptr || facts_of(group.kind).is_on_poses();
}

int num_equations(const ConstraintGroup& group, const ConstraintMember& member) {
  if (group.function) return group.function->rows();
  const ConstraintKindFacts& facts = facts_of(group.kind);
  const int images = static_cast<int>(member.points.size()) / 3;
  return std::min(facts.compares_images() ? 2 * images : facts.entries, facts.freedom);
}

double squared_error(const ConstraintResidual& e) {
  double sum = 0.0;
  for (int row = 0; row < e.rows; ++row) sum += e.residual[row] * e.residual[row];
  return sum;
}

void apply_loss(const Loss& loss, ConstraintResidual& e) {
  if (loss.kind == LossKind::kSquared) return;
  const double factor = std::sqrt(loss.derivative(squared_error(e)));
  scale(factor, e.residual);
  scale(factor, e.by_camera);
  scale(factor, e.by_previous);
}

void evaluate(const ConstraintGroup& group,
              const ConstraintMember& member,
              const ConstrainedCameras& cameras,
              const ConstraintColumns* columns,
              ConstraintResidual& out) {
  if (facts_of(group.kind).is_on_poses()) {
    evaluate_pose(member, cameras, columns, out);
  } else {
    evaluate_intrinsics(group.kind, member, cameras, columns, out);
  }
  apply_weights(group, member, out);
}

void evaluate_all(const ConstraintGroup& group,
                  const ConstrainedCameras& cameras,
                  const ConstraintColumns* columns,
                  const ResidualVisitor& visit) {
  if (group.function) {
    if (group.weight > 0.0) evaluate_function(group, cameras, columns, visit);
    return;
  }
  ConstraintResidual e;
  for (std::size_t k = 0; k < group.members.size(); ++k) {
    if (!is_active(group, group.members[k])) continue;
    evaluate(group, group.members[k], cameras, columns, e);
    visit(k, e);
  }
}

}  // namespace sfmcpp::residuals

#include "sfmcpp/residuals/constraint_set.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace sfmcpp::residuals {
namespace {

double group_cost(const ConstraintGroup& group, const ConstrainedCameras& cameras) {
  double sum = 0.0;
  evaluate_all(group, cameras, nullptr, [&](std::size_t, const ConstraintResidual& e) {
    sum += group.loss.rho(squared_error(e));
  });
  return 0.5 * sum;
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

// All members of a group are evaluated in one call: they have the same arguments.
void check_arguments(const ConstraintGroup& group, std::size_t k) {
  const ConstraintMember &member = group.members[k], &first = group.members[0];
  const auto differs = [&](int ConstraintMember::*part) {
    return (member.*part == kNoCamera) != (first.*part == kNoCamera);
  };
  if (differs(&ConstraintMember::camera) || differs(&ConstraintMember::previous) ||
      differs(&ConstraintMember::point)) {
    refuse(name_of(group, k), "of other cameras and points than [0]: must be alike in a group");
  }
  if (member.point == kNoPoint) return;
  if (!group.function) refuse(name_of(group, k) + ".point", kind_text(group) + " is on cameras");
  if (member.previous != kNoPrevious)
    refuse(name_of(group, k) + ".point", "with two cameras: must be with one or none");
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

void check_point(const std::string& name, int point, int count) {
  if (point >= 0 && point < count) return;
  refuse(name + ".points",
         "point " + std::to_string(point) + ": must be in [0, " + std::to_string(count) + ")");
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
           kind_text(group) + ": camera model '" + std::string(cameras.camera_model.name()) +
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

template <class E>
void check_enumerator(const ConstraintGroup& group, const char* part, E value) {
  if (is_enumerator(value)) return;
  refuse(
      "constraints['" + group.name + "']." + part + " = " + std::to_string(static_cast<int>(value)),
      "is none of its values");
}

// Of each member, the entries of e.
std::size_t num_entries(const ConstraintGroup& group, const ConstraintMember& member) {
  if (group.function) return static_cast<std::size_t>(group.function->rows());
  if (!facts_of(group.kind).is_on_poses()) return facts_of(group.kind).entries;
  return static_cast<std::size_t>(residual_size(measurement_of(member)));
}

void check_weights(const ConstraintGroup& group, std::size_t k) {
  const ConstraintMember& member = group.members[k];
  const std::string name = name_of(group, k) + ".weight";
  check_weight(name, member.weight);
  for (double weight : member.entry_weights) check_weight(name, weight);
  const std::size_t given = member.entry_weights.size(), entries = num_entries(group, member);
  if (given != 0 && given != entries)
    refuse(name,
           "one for each of " + std::to_string(given) + " entries, has " + std::to_string(entries));
}

void check_group(const ConstraintGroup& group) {
  if (group.name.empty()) refuse("constraints", "a group has an empty name");
  check_enumerator(group, "kind", group.kind);
  check_enumerator(group, "loss.kind", group.loss.kind);
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
  if (group.function && group.function->rows() < 1) {
    refuse("constraints['" + group.name + "'].function",
           "has " + std::to_string(group.function->rows()) + " rows: must have at least one");
  }
  for (std::size_t k = 0; k < group.members.size(); ++k) {
    const ConstraintMember& member = group.members[k];
    check_previous(group, k);
    if (group.function || member.point != kNoPoint) check_arguments(group, k);
    if (group.function) continue;
    if (facts_of(group.kind).is_on_poses()) {
      validate(measurement_of(member), name_of(group, k));
    } else {
      check_intrinsics_measurement(group, k);
    }
  }
  for (std::size_t k = 0; k < group.members.size(); ++k) check_weights(group, k);
}

void check_member(const ConstraintGroup& group, std::size_t k, const ConstrainedCameras& cameras) {
  const ConstraintMember& member = group.members[k];
  if (!is_metric(cameras.camera_model)) {
    refuse("constraints['" + group.name + "']",
           "camera_model = '" + std::string(cameras.camera_model.name()) +
               "': constraints are on poses and focal lengths of metric cameras");
  }
  if (member.point != kNoPoint) check_point(name_of(group, k), member.point, cameras.num_points);
  if (member.point == kNoPoint || member.camera != kNoCamera)
    check_camera(name_of(group, k), member.camera, cameras.count);
  if (member.previous != kNoPrevious)
    check_camera(name_of(group, k), member.previous, cameras.count);
  if (group.function) return;
  if (facts_of(group.kind).compares_images() && cameras.camera_model.function() != nullptr) {
    refuse("constraints['" + group.name + "']",
           "camera_model = '" + std::string(cameras.camera_model.name()) +
               "', a function: images of frozen points need a compiled model");
  }
  if (!facts_of(group.kind).is_on_poses()) check_intrinsics(group, k, cameras);
  if (facts_of(group.kind).compares_images()) check_frozen_points(group, k, cameras);
}

}  // namespace

void ConstraintSet::add(ConstraintGroup group) {
  for (const ConstraintGroup& other : groups_) {
    if (other.name == group.name)
      throw InvalidArgument("constraints['" + group.name +
                            "']: two groups have this name; each needs a name of its own");
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

std::vector<int> constrained_intrinsics(ConstraintKind kind, const CameraModel& model) {
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

bool is_on_points(const ConstraintGroup& group) {
  return !group.members.empty() && group.members[0].point != kNoPoint;
}

int num_equations(const ConstraintGroup& group, const ConstraintMember& member) {
  if (group.function) return group.function->rows();
  const ConstraintKindFacts& facts = facts_of(group.kind);
  const int images = static_cast<int>(member.points.size()) / 3;
  return std::min(facts.compares_images() ? 2 * images : facts.entries, facts.freedom);
}

}  // namespace sfmcpp::residuals

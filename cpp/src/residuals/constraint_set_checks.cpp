#include "constraint_set_checks.hpp"

#include <cmath>

#include "sfmcpp/cameras/pose.hpp"

namespace sfmcpp::residuals {
namespace {

[[noreturn]] void refuse(const std::string& name, const std::string& rule) {
  throw InvalidArgument(name + ": " + rule);
}

std::string kind_text(const ConstraintGroup& group) {
  std::string text("'");
  return text.append(constraint_kind_name(group.kind)).append("'");
}

void check_previous(const ConstraintGroup& group, std::size_t k) {
  const ConstraintMember& member = group.members[k];
  const bool has_previous = member.previous != kNoPrevious;
  if (const auto* kind = std::get_if<PoseConstraintKind>(&group.kind)) {
    if (relates_two_poses(*kind) != has_previous) {
      refuse(name_of(group, k),
             "kind " + kind_text(group) + " is on " +
                 (has_previous ? "one camera, two are given" : "two cameras, one is given"));
    }
  }
  if (has_previous && member.previous == member.camera) {
    refuse(name_of(group, k) + ".cameras",
           "camera " + std::to_string(member.camera) + " twice: must be two different ones");
  }
}

void check_intrinsics_measurement(const ConstraintGroup& group, std::size_t k) {
  const ConstraintMember& member = group.members[k];
  if (member.previous != kNoPrevious) return;
  const int size = residual_size(std::get<IntrinsicsConstraintKind>(group.kind));
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
  const int wanted = residual_size(std::get<IntrinsicsConstraintKind>(group.kind));
  const auto indices = constrained_intrinsics(group.kind, cameras.camera_model);
  if (!has_free_intrinsics(cameras.camera_model) || static_cast<int>(indices.size()) < wanted) {
    refuse(name_of(group, k),
           "kind " + kind_text(group) + ": camera model '" +
               std::string(enum_name(cameras.camera_model)) + "' has no such free parameter");
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

}  // namespace

void check_weight(const std::string& name, double weight) {
  if (weight >= 0.0 && std::isfinite(weight)) return;
  refuse(name + " = " + std::to_string(weight), "must be finite and not negative");
}

void check_group(const ConstraintGroup& group) {
  if (group.name.empty()) refuse("constraints", "a group has an empty name");
  check_weight("constraints['" + group.name + "'].weight", group.weight);
  for (std::size_t k = 0; k < group.members.size(); ++k) {
    const ConstraintMember& member = group.members[k];
    check_weight(name_of(group, k) + ".weight", member.weight);
    check_previous(group, k);
    if (std::holds_alternative<IntrinsicsConstraintKind>(group.kind)) {
      check_intrinsics_measurement(group, k);
    } else {
      validate(measurement_of(member), name_of(group, k));
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
  if (std::holds_alternative<IntrinsicsConstraintKind>(group.kind)) {
    check_intrinsics(group, k, cameras);
  } else if (compares_images(member.pose.kind)) {
    check_frozen_points(group, k, cameras);
  }
}

}  // namespace sfmcpp::residuals

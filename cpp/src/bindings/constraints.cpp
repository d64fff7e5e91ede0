#include "constraints.hpp"

#include <algorithm>
#include <array>
#include <string>

#include <Eigen/Core>

#include "arrays.hpp"

namespace sfmcpp::bindings {
namespace {

using residuals::ConstraintGroup;
using residuals::ConstraintMember;

using PoseMatrix = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
using RotationMatrix = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

// The number of values tells what they are: 3×4 poses, 3×3 rotations, positions, …
void set_measurement(residuals::ConstraintKind kind,
                     std::span<const double> values,
                     ConstraintMember& member) {
  if (values.size() == 12) {
    const Eigen::Map<const PoseMatrix> pose(values.data());
    member.pose.rotation = pose.leftCols<3>();
    member.pose.translation = pose.col(3);
  } else if (values.size() == 9) {
    member.pose.rotation = Eigen::Map<const RotationMatrix>(values.data());
  } else if (values.size() == 3) {
    member.pose.translation = Eigen::Map<const Eigen::Vector3d>(values.data());
  } else if (std::holds_alternative<residuals::PoseConstraintKind>(kind)) {
    if (!values.empty()) member.pose.distance = values[0];
  } else {
    std::copy(values.begin(), values.end(), member.intrinsics.begin());
  }
}

// f, aspect, cx, cy, skew of a camera. One that is out of range is refused later.
std::array<double, 5> pinhole_of(const ba::Problem& problem, int camera) {
  constexpr std::array<std::string_view, 5> kNames{"f", "aspect", "cx", "cy", "skew"};
  std::array<double, 5> pinhole{1.0, 1.0, 0.0, 0.0, 0.0};
  if (camera < 0 || camera >= static_cast<int>(problem.intrinsics_index.size())) return pinhole;
  const int row = problem.intrinsics_index[camera];
  if (row < 0 || row >= problem.num_groups()) return pinhole;
  const auto names = intrinsic_names(problem.camera_model);
  for (std::size_t k = 0; k < names.size(); ++k) {
    const auto found = std::find(kNames.begin(), kNames.end(), names[k]);
    if (found != kNames.end())
      pinhole[found - kNames.begin()] = problem.intrinsics[names.size() * row + k];
  }
  return pinhole;
}

ConstraintGroup group_of(const py::dict& arrays, const ba::Problem& problem) {
  ConstraintGroup group;
  group.name = arrays["name"].cast<std::string>();
  group.kind = residuals::parse_constraint_kind(arrays["kind"].cast<std::string>());
  group.weight = arrays["weight"].cast<double>();
  const auto cameras = view<const int>(arrays, "cameras");  // previous, this
  const auto values = view<const double>(arrays, "values");
  const auto weights = view<const double>(arrays, "member_weights");
  const auto points = view<const double>(arrays, "points");
  const auto points_begin = view<const int>(arrays, "points_begin");
  const std::size_t count = weights.size(), width = count == 0 ? 0 : values.size() / count;
  for (std::size_t k = 0; k < count; ++k) {
    ConstraintMember member;
    member.previous = cameras[2 * k];
    member.camera = cameras[2 * k + 1];
    member.weight = weights[k];
    set_measurement(group.kind, values.subspan(width * k, width), member);
    member.pose.intrinsics = pinhole_of(problem, member.camera);
    member.points.assign(points.begin() + 3L * points_begin[k],
                         points.begin() + 3L * points_begin[k + 1]);
    group.members.push_back(std::move(member));
  }
  return group;
}

}  // namespace

residuals::ConstraintSet constraints_of(const py::dict& arrays, const ba::Problem& problem) {
  residuals::ConstraintSet set;
  if (!arrays.contains("constraints")) return set;
  for (const py::handle group : arrays["constraints"])
    set.add(group_of(py::reinterpret_borrow<py::dict>(group), problem));
  return set;
}

}  // namespace sfmcpp::bindings

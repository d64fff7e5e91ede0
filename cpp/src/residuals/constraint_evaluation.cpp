// A member of a group as weighted residual, with its Jacobians in the columns of camera blocks.
#include <algorithm>
#include <cmath>

#include "sfmcpp/cameras/pose.hpp"
#include "sfmcpp/residuals/constraint_set.hpp"

namespace sfmcpp::residuals {
namespace {

double* resized(std::vector<double>& values, long size) {
  values.assign(static_cast<std::size_t>(size), 0.0);
  return values.data();
}

void scale(double factor, std::vector<double>& values) {
  for (double& value : values) value *= factor;
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

void evaluate_intrinsics(IntrinsicsConstraintKind kind,
                         const ConstraintMember& member,
                         const ConstrainedCameras& cameras,
                         const ConstraintColumns* columns,
                         ConstraintResidual& out) {
  const std::vector<int> indices = constrained_intrinsics(kind, cameras.camera_model);
  const bool two = member.previous != kNoPrevious;
  const auto values = parameters(cameras, member.camera, indices);
  const auto reference = two ? parameters(cameras, member.previous, indices) : member.intrinsics;
  const IntrinsicsResidual e = evaluate(kind, values.data(), reference.data());
  out.rows = residual_size(kind);
  out.residual.assign(e.residual.begin(), e.residual.begin() + out.rows);
  if (columns == nullptr) return;
  place(e.by_values, indices, *columns, out.by_camera);
  if (two) place(e.by_reference, indices, *columns, out.by_previous);
}

}  // namespace

const double* ConstrainedCameras::intrinsics_of(int i) const {
  return intrinsics + static_cast<long>(intrinsic_names(camera_model).size()) * intrinsics_index[i];
}

PoseConstraint measurement_of(const ConstraintMember& member) {
  PoseConstraint constraint = member.pose;
  constraint.points = member.points;
  return constraint;
}

std::vector<int> constrained_intrinsics(ConstraintKind kind, CameraModelId model) {
  const auto* on = std::get_if<IntrinsicsConstraintKind>(&kind);
  std::vector<int> indices;
  if (on == nullptr) return indices;
  const auto names = intrinsic_names(model);
  for (int k = 0; k < static_cast<int>(names.size()); ++k) {
    const bool is_focal = names[k] == "f", is_centre = names[k] == "cx" || names[k] == "cy";
    if (*on == IntrinsicsConstraintKind::kFocal ? is_focal : is_centre) indices.push_back(k);
  }
  return indices;
}

int num_equations(ConstraintKind kind, const ConstraintMember& member) {
  if (const auto* on = std::get_if<IntrinsicsConstraintKind>(&kind)) return residual_size(*on);
  const int size = residual_size(measurement_of(member));
  const auto pose_kind = std::get<PoseConstraintKind>(kind);
  const bool on_rotation = pose_kind == PoseConstraintKind::kOrientation ||
                           pose_kind == PoseConstraintKind::kOrientationReprojections ||
                           pose_kind == PoseConstraintKind::kDisplacementRotation;
  return std::min(size, on_rotation ? 3 : kPoseTangent);
}

void evaluate(const ConstraintGroup& group,
              const ConstraintMember& member,
              const ConstrainedCameras& cameras,
              const ConstraintColumns* columns,
              ConstraintResidual& out) {
  if (const auto* kind = std::get_if<IntrinsicsConstraintKind>(&group.kind)) {
    evaluate_intrinsics(*kind, member, cameras, columns, out);
  } else {
    evaluate_pose(member, cameras, columns, out);
  }
  const double factor = std::sqrt(group.weight * member.weight);
  scale(factor, out.residual);
  if (columns == nullptr) return;
  scale(factor, out.by_camera);
  scale(factor, out.by_previous);
}

}  // namespace sfmcpp::residuals

#include <algorithm>
#include <cmath>
#include <limits>

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

// Each of the rows of a residual or of a Jacobian.
void scale_rows(std::span<const double> factors, std::vector<double>& values) {
  const std::size_t width = values.size() / factors.size();
  for (std::size_t i = 0; i < values.size(); ++i) values[i] *= factors[i / width];
}

void apply_weights(const ConstraintGroup& group,
                   const ConstraintMember& member,
                   ConstraintResidual& e) {
  const double factor = std::sqrt(group.weight * member.weight);
  for (std::vector<double>* values : e.all()) scale(factor, *values);
  if (member.entry_weights.empty()) return;
  std::vector<double> roots(member.entry_weights.size());
  std::ranges::transform(
      member.entry_weights, roots.begin(), [](double weight) { return std::sqrt(weight); });
  for (std::vector<double>* values : e.all()) scale_rows(roots, *values);
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

int poses_of_member(const ConstraintGroup& group) {
  if (group.members.empty()) return 1;
  const ConstraintMember& member = group.members[0];
  return (member.previous != kNoPrevious) + (member.camera != kNoCamera);
}

std::vector<double> poses_of(const ConstraintGroup& group, const ConstrainedCameras& cameras) {
  std::vector<double> poses;
  poses.reserve(2UL * kCameraStorage * group.members.size());
  for (const ConstraintMember& member : group.members) {
    for (int camera : {member.previous, member.camera}) {
      if (camera == kNoCamera) continue;
      poses.insert(poses.end(), cameras.pose(camera), cameras.pose(camera) + kCameraStorage);
    }
  }
  return poses;
}

std::vector<double> points_of(const ConstraintGroup& group, const ConstrainedCameras& cameras) {
  std::vector<double> points;
  if (!is_on_points(group)) return points;
  points.reserve(kPointTangent * group.members.size());
  for (const ConstraintMember& member : group.members) {
    const double* point = cameras.points + long{kPointTangent} * member.point;
    points.insert(points.end(), point, point + kPointTangent);
  }
  return points;
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

// What a function answers for all members.
struct Answer {
  int rows, poses;
  std::vector<double> residuals{}, by_poses{}, by_points{};
};

double* place_of(std::vector<double>& values) { return values.empty() ? nullptr : values.data(); }

// What the function does not write is no number: zeros would pass for residuals and derivatives.
Answer answer_of(const ConstraintGroup& group, const ConstrainedCameras& cameras, bool jacobian) {
  constexpr double kUnwritten = std::numeric_limits<double>::quiet_NaN();
  Answer answer{.rows = group.function->rows(), .poses = poses_of_member(group)};
  const std::size_t size = group.members.size() * answer.rows;
  answer.residuals.assign(size, kUnwritten);
  if (jacobian) answer.by_poses.assign(size * answer.poses * kPoseTangent, kUnwritten);
  if (jacobian && is_on_points(group)) answer.by_points.assign(size * kPointTangent, kUnwritten);
  group.function->evaluate(
      poses_of(group, cameras).data(),
      points_of(group, cameras).data(),
      {answer.residuals.data(), place_of(answer.by_poses), place_of(answer.by_points)});
  return answer;
}

// The numbers of member k, `size` for each.
void take_rows(const std::vector<double>& all,
               std::size_t k,
               std::size_t size,
               std::vector<double>& out) {
  if (!all.empty()) out.assign(all.begin() + size * k, all.begin() + size * (k + 1));
}

void take_jacobians(const Answer& answer,
                    std::size_t k,
                    const ConstraintColumns& columns,
                    ConstraintResidual& e) {
  const auto take = [&](int pose, std::vector<double>& out) {
    const long size = long{answer.rows} * answer.poses * kPoseTangent;
    take_columns(answer.by_poses.data() + size * k, answer.rows, answer.poses, pose, out);
    widen(answer.rows, columns.width, out);
  };
  if (answer.poses > 0) take(answer.poses - 1, e.by_camera);
  if (answer.poses == 2) take(0, e.by_previous);
  take_rows(answer.by_points, k, std::size_t{kPointTangent} * answer.rows, e.by_point);
}

void evaluate_function(const ConstraintGroup& group,
                       const ConstrainedCameras& cameras,
                       const ConstraintColumns* columns,
                       const ResidualVisitor& visit) {
  const Answer answer = answer_of(group, cameras, columns != nullptr);
  ConstraintResidual e{.rows = answer.rows};
  for (std::size_t k = 0; k < group.members.size(); ++k) {
    if (!is_active(group, group.members[k])) continue;
    take_rows(answer.residuals, k, answer.rows, e.residual);
    if (columns != nullptr) take_jacobians(answer, k, *columns, e);
    apply_weights(group, group.members[k], e);
    visit(k, e);
  }
}

}  // namespace

double squared_error(const ConstraintResidual& e) {
  double sum = 0.0;
  for (int row = 0; row < e.rows; ++row) sum += e.residual[row] * e.residual[row];
  return sum;
}

void apply_loss(const Loss& loss, ConstraintResidual& e) {
  if (loss.is_squared()) return;
  const double factor = std::sqrt(loss.derivative(squared_error(e)));
  for (std::vector<double>* values : e.all()) scale(factor, *values);
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
    if (group.weight > 0.0 && !group.members.empty())
      evaluate_function(group, cameras, columns, visit);
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

#include <cmath>
#include <string>

#include "sfmcpp/ba/pose_refinement.hpp"
#include "sfmcpp/core/options_check.hpp"
#include "sfmcpp/math/so3.hpp"
#include "sfmcpp/residuals/whitening.hpp"

namespace sfmcpp::ba {
namespace {

constexpr int kFewestObservations = 4;  // three determine a pose; one more can be left out

std::string entry_and_value(const char* name, std::size_t index, double value) {
  return entry(name, index) + " = " + std::to_string(value);
}

void require_finite(std::span<const double> values, const char* name) {
  for (std::size_t k = 0; k < values.size(); ++k) {
    if (!std::isfinite(values[k]))
      throw InvalidArgument(entry_and_value(name, k, values[k]) + ": must be finite");
  }
}

void require_size(std::span<const double> values, const char* name, std::size_t size) {
  if (values.size() != size) {
    throw InvalidArgument(std::string(name) + ": " + std::to_string(values.size()) +
                          " numbers, must be " + std::to_string(size));
  }
}

void require_positive(std::span<const double> values, const char* name) {
  require_finite(values, name);
  for (std::size_t k = 0; k < values.size(); ++k) {
    if (values[k] <= 0.0)
      throw InvalidArgument(entry_and_value(name, k, values[k]) + ": must be positive");
  }
}

}  // namespace

void PoseSweepOptions::validate() const {
  OptionsCheck check;
  check.require(max_iterations >= 1, "max_iterations", max_iterations, "at least 1");
  check.require(fold_iterations >= 1, "fold_iterations", fold_iterations, "at least 1");
  check.require(
      std::isfinite(inlier_px) && inlier_px > 0.0, "inlier_px", inlier_px, "finite and positive");
  check.require(threads >= 0, "threads", threads, "not negative");
  check.done();
}

void require_weight(double weight, const char* name, std::size_t index) {
  if (!(std::isfinite(weight) && weight >= 0.0))
    throw InvalidArgument(entry_and_value(name, index, weight) +
                          ": must be finite and not negative");
}

void check_pose(const double* pose, const char* name) {
  require_finite({pose, 12}, name);
  const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> matrix(pose);
  if (!is_rotation(matrix.leftCols<3>())) {
    throw InvalidArgument(std::string(name) +
                          ": its left 3×3 block must be a rotation matrix, orthonormal to 1e-6");
  }
}

void check_pose_view(const PoseView& view) {
  const auto n = static_cast<std::size_t>(view.count());
  require_size(view.pixels, "pixels", 2 * n);
  require_size(view.points, "points", 3 * n);
  if (!view.sigma_px.empty()) require_size(view.sigma_px, "sigma_px", n);
  require_size(view.intrinsics, "intrinsics", intrinsic_names(view.camera_model).size());
  if (view.count() < kFewestObservations) {
    throw InvalidArgument("points: " + std::to_string(n) + ", must be at least " +
                          std::to_string(kFewestObservations) + " to leave one out");
  }
  require_finite(view.intrinsics, "intrinsics");
  require_finite(view.points, "points");
  require_finite(view.pixels, "pixels");
  require_positive(view.sigma_px, "sigma_px");
  residuals::check_covariances(view.sigma_px, view.covariance_px2, n);
}

void check_constraints(std::span<const WeightedConstraint> constraints) {
  for (std::size_t k = 0; k < constraints.size(); ++k) {
    const std::string name = "constraints[" + std::to_string(k) + "]";
    residuals::validate(constraints[k].constraint, name);
    require_weight(constraints[k].weight, "weight of constraints", k);
    if (facts_of(constraints[k].constraint.kind).relates_two_poses())
      check_pose(constraints[k].previous.data(), (name + ".previous").c_str());
  }
}

}  // namespace sfmcpp::ba

#include "sfmcpp/ba/pose_refinement.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "pose_fit.hpp"
#include "sfmcpp/ba/solve_options.hpp"
#include "sfmcpp/cameras/matrix34.hpp"
#include "sfmcpp/core/options_check.hpp"
#include "sfmcpp/core/parallel.hpp"
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
  check.require(kNumThreads.holds(threads), "threads", threads, kNumThreads.text);
  check.done();
}

void require_weight(double weight, const char* name, std::size_t index) {
  if (!(std::isfinite(weight) && weight >= 0.0))
    throw InvalidArgument(entry_and_value(name, index, weight) +
                          ": must be finite and not negative");
}

void check_pose(const double* pose, const char* name) {
  require_finite({pose, 12}, name);
  const PoseMatrixView matrix(pose);
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

namespace {

class Sweep {
 public:
  Sweep(PoseFit& fit, const PoseSweepOptions& options, std::size_t num_weights)
      : fit_(fit), options_(options) {
    if (options.leave_one_out) minima_.reserve(num_weights);
    result_.poses.reserve(12 * num_weights);
    for (auto* values : {&result_.vision,
                         &result_.held,
                         &result_.constraint,
                         &result_.constraint_slope,
                         &result_.approximate_leave_one_out})
      values->reserve(num_weights);
  }

  void visit(double weight, LinearizedPose& at) {
    result_.converged.push_back(fit_.minimize(weight, options_.max_iterations, at));
    result_.poses.insert(result_.poses.end(), at.pose, at.pose + 12);
    result_.vision.push_back(fit_.vision(at));
    result_.held.push_back(at.held.cost);
    result_.constraint.push_back(at.selected.cost);
    result_.constraint_slope.push_back(fit_.constraint_slope(weight, at));
    result_.inliers.push_back(fit_.inliers(options_.inlier_px, at));
    if (options_.leave_one_out) minima_.push_back(at);
    if (options_.approximate_leave_one_out)
      result_.approximate_leave_one_out.push_back(fit_.approximate_leave_one_out(weight, at));
  }

  // The exact scores: the folds of each weight are one task.
  void leave_one_out(const PoseView& view,
                     std::span<const WeightedConstraint> constraints,
                     int selected,
                     std::span<const double> weights) {
    const long folds = static_cast<long>(minima_.size()) * view.count();
    ThreadPool pool(resolve_num_threads(options_.threads, folds * view.count() / 10));
    std::vector<std::unique_ptr<PoseFit>> fits(pool.num_threads());  // room of each worker
    for (std::unique_ptr<PoseFit>& fit : fits)
      fit = std::make_unique<PoseFit>(view, constraints, selected);
    result_.leave_one_out.resize(minima_.size());
    pool.parallel_for_worker(static_cast<int>(minima_.size()), [&](int k, int worker) {
      result_.leave_one_out[k] =
          fits[worker]->leave_one_out(weights[k], options_.fold_iterations, minima_[k]);
    });
  }

  PoseSweep take() { return std::move(result_); }

 private:
  PoseFit& fit_;
  const PoseSweepOptions& options_;
  std::vector<LinearizedPose> minima_;
  PoseSweep result_;
};

Eigen::Matrix<double, 6, 6> unpacked(const double* lower) {
  Eigen::Matrix<double, 6, 6> m;
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column <= row; ++column) m(row, column) = m(column, row) = *lower++;
  }
  return m;
}

void check_sweep(int num_constraints, int selected, std::span<const double> weights) {
  if (selected < 0 || selected >= num_constraints) {
    throw InvalidArgument("selected = " + std::to_string(selected) + ": must be one of " +
                          std::to_string(num_constraints) + " constraints");
  }
  for (std::size_t k = 0; k < weights.size(); ++k) require_weight(weights[k], "weights", k);
}

LinearizedPose start_of(PoseFit& fit, const double* start) {
  LinearizedPose at;
  std::copy_n(start, 12, at.pose);
  fit.linearize(at);
  return at;
}

}  // namespace

PoseSweep sweep_pose_weights(const PoseView& view,
                             std::span<const WeightedConstraint> constraints,
                             int selected,
                             std::span<const double> weights,
                             const double* start,
                             const PoseSweepOptions& options) {
  options.validate();
  check_pose_view(view);
  check_constraints(constraints);
  check_pose(start, "start");
  check_sweep(static_cast<int>(constraints.size()), selected, weights);
  PoseFit fit(view, constraints, selected);
  LinearizedPose at = start_of(fit, start);
  Sweep sweep(fit, options, weights.size());
  for (double weight : weights) sweep.visit(weight, at);
  if (options.leave_one_out) sweep.leave_one_out(view, constraints, selected, weights);
  return sweep.take();
}

PoseLinearization linearize_pose(const PoseView& view,
                                 std::span<const WeightedConstraint> constraints,
                                 const double* pose) {
  check_pose_view(view);
  check_constraints(constraints);
  check_pose(pose, "pose");
  PoseFit fit(view, {}, -1);
  const LinearizedPose at = start_of(fit, pose);
  PoseLinearization result{unpacked(at.vision.normal),
                           Eigen::Map<const Eigen::Matrix<double, 6, 1>>(at.vision.gradient),
                           fit.vision(at),
                           {},
                           {}};
  for (const WeightedConstraint& c : constraints) {
    const int size = residuals::residual_size(c.constraint);
    Eigen::VectorXd residual(size);
    Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::RowMajor> jacobian(size, 6);
    residuals::evaluate(c.constraint, pose, c.previous.data(), {residual.data(), jacobian.data()});
    result.residuals.push_back(std::move(residual));
    result.jacobians.emplace_back(jacobian);
  }
  return result;
}

PoseRefinement refine_pose(const PoseView& view,
                           std::span<const WeightedConstraint> constraints,
                           const double* start,
                           const PoseSweepOptions& options) {
  options.validate();
  check_pose_view(view);
  check_constraints(constraints);
  check_pose(start, "start");
  PoseFit fit(view, constraints, -1);
  LinearizedPose at = start_of(fit, start);
  PoseRefinement result;
  result.converged = fit.minimize(0.0, options.max_iterations, at);
  std::copy_n(at.pose, 12, result.pose.begin());
  result.vision = fit.vision(at);
  for (const Eigen::VectorXd& e : linearize_pose(view, constraints, at.pose).residuals)
    result.constraints.push_back(e.squaredNorm());
  return result;
}

}  // namespace sfmcpp::ba

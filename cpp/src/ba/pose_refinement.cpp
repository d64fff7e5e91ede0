#include "sfmcpp/ba/pose_refinement.hpp"

#include <algorithm>
#include <memory>
#include <string>

#include "pose_fit.hpp"
#include "sfmcpp/core/parallel.hpp"

namespace sfmcpp::ba {
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

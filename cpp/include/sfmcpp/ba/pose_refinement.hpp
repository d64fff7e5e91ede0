// Fits of ONE pose to fixed points and weighted constraints, for many weights and many folds: the
// inner loops of weight selection (thesis §5.2.3; docs/equations.md §6).
//
//   F(R, t) = 1/n Σ_j ‖r_j‖² + Σ_k λ_k² ε_k        (thesis eqs 5.1, 5.15)
//
// r_j = (observed − projected) / σ_j, in units of σ, or whitened by a covariance; ε_k the mean
// squared error of constraint k (residuals/pose_constraints.hpp). Constraints that are not selected
// keep their weight.
//
// Leave-one-out (thesis eqs 5.8–5.9): the fit to the other n − 1 observations, with 1/(n − 1) in
// front, predicts the one left out; the score is the mean of ‖r‖² so found. Exact: a few steps of
// Levenberg–Marquardt for each fold, from the optimum of all. Approximate: the first of these steps
// in closed form for all folds at once. With M = JᵀJ/(n−1) + Σ λ²JₖᵀJₖ and b = Jᵀr/(n−1) − Σ
// λ²Jₖᵀeₖ at that optimum, without j both lose J_jᵀJ_j/(n−1) and J_jᵀr_j/(n−1), and by Woodbury's
// identity
//   r_j − J_j δ_j = (I − J_j M⁻¹ J_jᵀ/(n−1))⁻¹ (r_j − J_j M⁻¹ b)
// (after Bartoli, "Maximizing the predictivity of smooth deformable image warps through
// cross-validation", JMIV 2008; the thesis names it and did not build it).
//
// Deterministic, with the same bits for every number of threads; nothing is allocated from one
// weight or fold to the next.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "sfmcpp/cameras/camera_model.hpp"
#include "sfmcpp/residuals/pose_constraints.hpp"

namespace sfmcpp::ba {

// What one camera sees; views of the caller's arrays.
struct PoseView {
  CameraModelId camera_model = CameraModelId::kCalibrated;
  std::span<const double> intrinsics;        // K
  std::span<const double> points;            // n × 3, world, fixed
  std::span<const double> pixels;            // n × 2
  std::span<const double> sigma_px;          // n, or empty for 1 px
  std::span<const double> covariance_px2{};  // n × 2 × 2 instead of σ, or empty

  int count() const { return static_cast<int>(pixels.size()) / 2; }
};

struct WeightedConstraint {
  residuals::PoseConstraint constraint;
  double weight = 0.0;                // λ, while it is not the one selected
  std::array<double, 12> previous{};  // the earlier pose, for kinds that read it
};

struct PoseSweepOptions {
  int max_iterations = 20;  // of a fit
  int fold_iterations = 3;  // of a fold (thesis §5.2.3.2)
  double inlier_px = 2.0;
  bool leave_one_out = true;
  bool approximate_leave_one_out = true;
  int threads = 1;  // of the exact scores; 0: as many as the machine has and they are worth

  void validate() const;
};

// A number for each of W weights.
struct PoseSweep {
  std::vector<double> poses;             // W × 12
  std::vector<double> vision;            // 1/n Σ ‖r‖²
  std::vector<double> held;              // Σ λ² ε of the constraints not selected
  std::vector<double> constraint;        // ε of the one selected
  std::vector<double> constraint_slope;  // dε/d log λ along the optima, by the Gauss–Newton Hessian
  std::vector<double> leave_one_out;  // empty unless asked for
  std::vector<double> approximate_leave_one_out;
  std::vector<int> inliers;  // in front of the camera and within inlier_px
  std::vector<std::uint8_t> converged;
};

// One fit for each weight of constraint `selected`, each from the optimum of the weight before, the
// first from `start`. Throws InvalidArgument for arrays that do not fit, fewer than four
// observations, or numbers out of range.
PoseSweep sweep_pose_weights(const PoseView& view,
                             std::span<const WeightedConstraint> constraints,
                             int selected,
                             std::span<const double> weights,
                             const double* start,
                             const PoseSweepOptions& options);

struct PoseRefinement {
  std::array<double, 12> pose;
  double vision;                    // 1/n Σ ‖r‖²
  std::vector<double> constraints;  // ε of each
  bool converged;
};

// The fit with every constraint at its own weight.
PoseRefinement refine_pose(const PoseView& view,
                           std::span<const WeightedConstraint> constraints,
                           const double* start,
                           const PoseSweepOptions& options);

// First-order model at a pose, for covariances: columns (δR, δt).
struct PoseLinearization {
  Eigen::Matrix<double, 6, 6> vision_normal;    // Σ JᵀJ, of all observations
  Eigen::Matrix<double, 6, 1> vision_gradient;  // Σ Jᵀr
  double vision;                                // 1/n Σ ‖r‖²
  std::vector<Eigen::VectorXd> residuals;       // e of each constraint
  std::vector<Eigen::Matrix<double, Eigen::Dynamic, 6>> jacobians;
};

PoseLinearization linearize_pose(const PoseView& view,
                                 std::span<const WeightedConstraint> constraints,
                                 const double* pose);

// Throws InvalidArgument; called by the functions above.
void check_pose_view(const PoseView& view);
void check_pose(const double* pose, const char* name);
void check_constraints(std::span<const WeightedConstraint> constraints);
void require_weight(double weight, const char* name, std::size_t index);

}  // namespace sfmcpp::ba

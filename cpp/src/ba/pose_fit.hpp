// The fit of one pose, again and again: six unknowns, fixed-size arithmetic, no allocation.
#pragma once

#include <span>
#include <vector>

#include "sfmcpp/ba/pose_refinement.hpp"
#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/math/packed_cholesky.hpp"
#include "sfmcpp/residuals/resection.hpp"

namespace sfmcpp::ba {

using Cholesky6 = PackedCholesky<6>;
using Lower6 = Cholesky6::Lower;
using Vector6 = Cholesky6::Vector;
using residuals::PoseSums;

// A pose with the sums of its observations, of the constraints held (times λ²), and of the one
// selected (as it is). Gradients point downhill: Jᵀr, −Jₖᵀeₖ.
struct LinearizedPose {
  double pose[12];
  PoseSums vision, held, selected;
};

class PoseFit {
 public:
  // `selected`: the constraint whose weight is an argument; −1: none.
  PoseFit(const PoseView& view, std::span<const WeightedConstraint> constraints, int selected);

  int count() const { return views_.count; }
  double vision(const LinearizedPose& at) const { return at.vision.cost / count(); }

  void linearize(LinearizedPose& at) { linearize(views_.inverse_sigma, at); }
  // Goes downhill from a linearised pose; true: to the minimum.
  bool minimize(double weight, int max_iterations, LinearizedPose& at);
  // dε/d log λ of the selected constraint at a minimum.
  double constraint_slope(double weight, const LinearizedPose& minimum) const;
  int inliers(double inlier_px, const LinearizedPose& at);

  // At the minimum of all observations.
  double leave_one_out(double weight, int fold_iterations, const LinearizedPose& minimum);
  double approximate_leave_one_out(double weight, const LinearizedPose& minimum);

 private:
  // One problem of minimisation: all observations, or all but one.
  struct Fold {
    const double* inverse_sigma;
    double share;           // of an observation in the mean
    double squared_weight;  // λ²
    double trusted;         // relative decrease of the cost from which a step is the last
  };

  double cost(const Fold& fold, const LinearizedPose& at) const;
  Lower6 normal(const Fold& fold, const LinearizedPose& at) const;
  Vector6 gradient(const Fold& fold, const LinearizedPose& at) const;
  bool descend(const Fold& fold, int max_iterations, LinearizedPose& at);
  void remove(int observation, PoseSums& sums) const;
  void linearize(const double* inverse_sigma, LinearizedPose& at);
  Fold all_observations(double weight) const;
  void add_constraint(int constraint, const double* pose, double factor, PoseSums& sums);
  void add_reprojections(int constraint, const double* pose, double factor, PoseSums& sums) const;

  residuals::PointViews storage_;
  residuals::ViewArrays views_;
  const double* intrinsics_;
  residuals::ResectionKernels kernels_;
  residuals::ResectionKernels frozen_kernels_;
  std::span<const WeightedConstraint> constraints_;
  std::vector<residuals::PointViews> frozen_;  // points of each constraint; none: empty
  int selected_;
  LinearizedPose candidate_;
  // Room to work in.
  AlignedVector<double> rows_, errors_, inverse_sigma_, residual_, jacobian_;
};

}  // namespace sfmcpp::ba

#include "pose_fit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "sfmcpp/cameras/pose.hpp"

namespace sfmcpp::ba {
namespace {

// Relative decreases of the cost: below the first, rounding decides whether a step helps, and the
// step is trusted; below the second, the pose does not change any more.
constexpr double kRounding = 1e-11;
constexpr double kNegligibleDecrease = 1e-18;
// A fold is done with a step of this decrease: what is left is smaller still by the square of the
// rate of convergence, and moves a prediction by less than 1e-5 of itself.
constexpr double kNegligibleDecreaseOfFold = 1e-9;
// A cost, in squared standard deviations, far below what any measurement can tell.
constexpr double kNoCost = 1e-24;
// Damping after the first step that fails: there is none before, as fits start near their minimum.
constexpr double kFirstDamping = 1e-3;

constexpr int diagonal_entry(int k) { return k * (k + 3) / 2; }

double dot(const Vector6& a, const Vector6& b) {
  double sum = 0.0;
  for (int k = 0; k < 6; ++k) sum += a[k] * b[k];
  return sum;
}

// Adds factor · (JᵀJ, −Jᵀe, ‖e‖²).
void add_rows(
    int size, const double* residual, const double* jacobian, double factor, PoseSums& sums) {
  for (int row = 0; row < size; ++row, jacobian += 6) {
    double* normal = sums.normal;
    const double e = factor * residual[row];
    for (int a = 0; a < 6; ++a) {
      const double scaled = factor * jacobian[a];
      for (int b = 0; b <= a; ++b) *normal++ += scaled * jacobian[b];
      sums.gradient[a] -= e * jacobian[a];
    }
    sums.cost += e * residual[row];
  }
}

void add(const PoseSums& part, double factor, PoseSums& sums) {
  for (int k = 0; k < PoseSums::kNormal; ++k) sums.normal[k] += factor * part.normal[k];
  for (int k = 0; k < PoseSums::kGradient; ++k) sums.gradient[k] += factor * part.gradient[k];
  sums.cost += factor * part.cost;
}

int largest_residual(std::span<const WeightedConstraint> constraints) {
  int size = 0;
  for (const WeightedConstraint& c : constraints)
    size = std::max(size, residuals::residual_size(c.constraint));
  return size;
}

// Its points, each with its share of the mean. Nothing is observed: both images are computed.
residuals::PointViews frozen_points(const residuals::PoseConstraint& c) {
  if (!facts_of(c.kind).compares_images()) return {{}, {}, {}};
  const std::size_t count = c.points.size() / 3;
  const std::vector<double> nowhere(2 * count), sigma(count, std::sqrt(static_cast<double>(count)));
  return {c.points, nowhere, sigma};
}

}  // namespace

PoseFit::PoseFit(const PoseView& view,
                 std::span<const WeightedConstraint> constraints,
                 int selected)
    : storage_(view.points, view.pixels, view.sigma_px, view.covariance_px2),
      views_(storage_.arrays()),
      intrinsics_(view.intrinsics.data()),
      kernels_(residuals::resection_kernels(view.camera_model)),
      frozen_kernels_(residuals::resection_kernels(CameraModelId::kCalibrated)),
      constraints_(constraints),
      selected_(selected),
      rows_(static_cast<std::size_t>(residuals::kViewRows) * views_.padded),
      errors_(views_.padded),
      inverse_sigma_(views_.inverse_sigma, views_.inverse_sigma + views_.padded),
      residual_(largest_residual(constraints)),
      jacobian_(6 * residual_.size()) {
  for (const WeightedConstraint& c : constraints) frozen_.push_back(frozen_points(c.constraint));
}

void PoseFit::linearize(const double* inverse_sigma, LinearizedPose& at) {
  kernels_.sums(views_, intrinsics_, at.pose, inverse_sigma, at.vision);
  at.held = at.selected = PoseSums{};
  for (int k = 0; k < static_cast<int>(constraints_.size()); ++k) {
    const double weight = constraints_[k].weight;
    if (k == selected_) {
      add_constraint(k, at.pose, 1.0, at.selected);
    } else if (weight > 0.0) {
      add_constraint(k, at.pose, weight * weight, at.held);
    }
  }
}

void PoseFit::add_constraint(int k, const double* pose, double factor, PoseSums& sums) {
  const WeightedConstraint& c = constraints_[k];
  if (facts_of(c.constraint.kind).compares_images())
    return add_reprojections(k, pose, factor, sums);
  residuals::evaluate(c.constraint, pose, c.previous.data(), {residual_.data(), jacobian_.data()});
  add_rows(
      residuals::residual_size(c.constraint), residual_.data(), jacobian_.data(), factor, sums);
}

// What evaluate() computes point by point, by the vector kernels.
void PoseFit::add_reprojections(int k, const double* pose, double factor, PoseSums& sums) const {
  const WeightedConstraint& c = constraints_[k];
  const bool same_centre = !facts_of(c.constraint.kind).relates_two_poses();
  std::array<double, 12> other = c.previous;
  for (int row = 0; row < 3 && same_centre; ++row) {
    for (int column = 0; column < 3; ++column)
      other[4 * row + column] = c.constraint.rotation(row, column);
    other[4 * row + 3] = pose[4 * row + 3];
  }
  PoseSums part;
  frozen_kernels_.sums_between(
      frozen_[k].arrays(), c.constraint.intrinsics.data(), pose, other.data(), same_centre, part);
  add(part, factor, sums);
}

double PoseFit::cost(const Fold& fold, const LinearizedPose& at) const {
  return fold.share * at.vision.cost + at.held.cost + fold.squared_weight * at.selected.cost;
}

Lower6 PoseFit::normal(const Fold& fold, const LinearizedPose& at) const {
  Lower6 lower;
  for (int k = 0; k < PoseSums::kNormal; ++k) {
    lower[k] = fold.share * at.vision.normal[k] + at.held.normal[k] +
               fold.squared_weight * at.selected.normal[k];
  }
  return lower;
}

Vector6 PoseFit::gradient(const Fold& fold, const LinearizedPose& at) const {
  Vector6 downhill;
  for (int k = 0; k < PoseSums::kGradient; ++k) {
    downhill[k] = fold.share * at.vision.gradient[k] + at.held.gradient[k] +
                  fold.squared_weight * at.selected.gradient[k];
  }
  return downhill;
}

PoseFit::Fold PoseFit::all_observations(double weight) const {
  return {views_.inverse_sigma, 1.0 / count(), weight * weight, kNegligibleDecrease};
}

bool PoseFit::minimize(double weight, int max_iterations, LinearizedPose& at) {
  const bool converged = descend(all_observations(weight), max_iterations, at);
  linearize(at);
  return converged;
}

// Levenberg–Marquardt (thesis eq. 2.45), undamped until a step fails. A step as small as `trusted`
// is the last one, and its pose is not linearised.
bool PoseFit::descend(const Fold& fold, int max_iterations, LinearizedPose& at) {
  double damping = 0.0;
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    Lower6 damped = normal(fold, at);
    for (int k = 0; k < 6; ++k) damped[diagonal_entry(k)] *= 1.0 + damping;
    const Cholesky6 cholesky(damped);
    const Vector6 downhill = gradient(fold, at), step = cholesky.solve(downhill);
    // Without damping the decrease that the model promises; with it, a little less.
    const double promise = dot(step, downhill), now = cost(fold, at) + kNoCost;
    plus_pose(at.pose, step.data(), candidate_.pose);
    if (cholesky.positive() && damping == 0.0 && promise <= fold.trusted * now) {
      std::copy_n(candidate_.pose, 12, at.pose);
      return true;
    }
    linearize(fold.inverse_sigma, candidate_);
    const bool succeeds = cost(fold, candidate_) < now || promise <= kRounding * now;
    if (cholesky.positive() && succeeds) {
      std::swap(at, candidate_);
      damping = damping > kFirstDamping ? damping / 10.0 : 0.0;
    } else {
      damping = std::max(kFirstDamping, 10.0 * damping);
    }
  }
  return false;
}

// At a minimum −½∇ε is the selected gradient g, and the optimum moves by 2λ² H⁻¹ g with log λ.
double PoseFit::constraint_slope(double weight, const LinearizedPose& minimum) const {
  Vector6 g;
  std::copy_n(minimum.selected.gradient, 6, g.begin());
  const Cholesky6 cholesky(normal(all_observations(weight), minimum));
  return cholesky.positive() ? -4.0 * weight * weight * dot(g, cholesky.solve(g)) : 0.0;
}

int PoseFit::inliers(double inlier_px, const LinearizedPose& at) {
  residuals::ViewArrays in_pixels = views_;
  in_pixels.shapes = {};
  kernels_.squared_errors(in_pixels, intrinsics_, at.pose, errors_.data());
  int inliers = 0;
  for (int j = 0; j < count(); ++j) {
    const double bound = inlier_px * views_.inverse_sigma[j];
    inliers += errors_[j] <= bound * bound;
  }
  return inliers;
}

double PoseFit::leave_one_out(double weight, int fold_iterations, const LinearizedPose& minimum) {
  kernels_.rows(views_, intrinsics_, minimum.pose, rows_.data());
  const Fold fold{
      inverse_sigma_.data(), 1.0 / (count() - 1), weight * weight, kNegligibleDecreaseOfFold};
  double sum = 0.0;
  for (int j = 0; j < count(); ++j) {
    // The linearisation at the optimum of all serves every fold.
    LinearizedPose at = minimum;
    remove(j, at.vision);
    inverse_sigma_[j] = 0.0;
    descend(fold, fold_iterations, at);
    inverse_sigma_[j] = views_.inverse_sigma[j];
    kernels_.squared_errors(views_, intrinsics_, at.pose, errors_.data());
    sum += errors_[j];
  }
  return sum / count();
}

void PoseFit::remove(int observation, PoseSums& sums) const {
  double row[residuals::kViewRows];
  for (int k = 0; k < residuals::kViewRows; ++k) row[k] = rows_[k * views_.padded + observation];
  const double minus_residual[2] = {-row[12], -row[13]};
  add_rows(2, minus_residual, row, -1.0, sums);
}

double PoseFit::approximate_leave_one_out(double weight, const LinearizedPose& minimum) {
  const Fold fold{views_.inverse_sigma, 1.0 / (count() - 1), weight * weight, kNegligibleDecrease};
  const Cholesky6 cholesky(normal(fold, minimum));
  if (!cholesky.positive()) return std::numeric_limits<double>::infinity();
  const Vector6 shift = cholesky.solve(gradient(fold, minimum));
  Lower6 whitener = cholesky.inverse_factor();
  for (double& entry : whitener) entry *= std::sqrt(fold.share);
  kernels_.rows(views_, intrinsics_, minimum.pose, rows_.data());
  kernels_.predicted_errors(
      rows_.data(), views_.padded, whitener.data(), shift.data(), errors_.data());
  double sum = 0.0;
  for (int j = 0; j < count(); ++j) sum += errors_[j];
  return sum / count();
}

}  // namespace sfmcpp::ba

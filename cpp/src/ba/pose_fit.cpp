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
constexpr double kNegligible = 1e-18;
// A cost, in squared standard deviations, far below what any measurement can tell.
constexpr double kNothing = 1e-24;
// Damping after the first step that fails: there is none before, as fits start near their minimum.
constexpr double kFirstDamping = 1e-3;

Eigen::Map<const Vector6> gradient_of(const PoseSums& sums) {
  return Eigen::Map<const Vector6>(sums.gradient);
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

int largest_residual(std::span<const WeightedConstraint> constraints) {
  int size = 0;
  for (const WeightedConstraint& c : constraints)
    size = std::max(size, residuals::residual_size(c.constraint));
  return size;
}

// L⁻¹ √factor as 21 numbers, of M = L Lᵀ.
void pack_whitener(const Eigen::LLT<Matrix6>& llt, double factor, double* packed) {
  Matrix6 inverse = std::sqrt(factor) * Matrix6::Identity();
  llt.matrixL().solveInPlace(inverse);
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column <= row; ++column) *packed++ = inverse(row, column);
  }
}

}  // namespace

Matrix6 unpacked(const double* lower) {
  Matrix6 m;
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column <= row; ++column) m(row, column) = m(column, row) = *lower++;
  }
  return m;
}

PoseFit::PoseFit(const PoseView& view,
                 std::span<const WeightedConstraint> constraints,
                 int selected)
    : storage_(view.points, view.pixels, view.sigma_px),
      views_(storage_.arrays()),
      intrinsics_(view.intrinsics.data()),
      kernels_(residuals::resection_kernels(view.camera_model)),
      constraints_(constraints),
      selected_(selected),
      rows_(static_cast<std::size_t>(residuals::kViewRows) * views_.padded),
      errors_(views_.padded),
      inverse_sigma_(views_.inverse_sigma, views_.inverse_sigma + views_.padded),
      residual_(largest_residual(constraints)),
      jacobian_(6 * residual_.size()) {}

void PoseFit::linearize(const double* inverse_sigma, LinearizedPose& at) {
  kernels_.sums(views_, intrinsics_, at.pose, inverse_sigma, at.vision);
  at.held = at.selected = PoseSums{};
  for (int k = 0; k < static_cast<int>(constraints_.size()); ++k) {
    const WeightedConstraint& c = constraints_[k];
    if (k == selected_) {
      add_constraint(c, at.pose, 1.0, at.selected);
    } else if (c.weight > 0.0) {
      add_constraint(c, at.pose, c.weight * c.weight, at.held);
    }
  }
}

void PoseFit::add_constraint(const WeightedConstraint& c,
                             const double* pose,
                             double factor,
                             PoseSums& sums) {
  residuals::evaluate(c.constraint, pose, c.previous.data(), {residual_.data(), jacobian_.data()});
  add_rows(
      residuals::residual_size(c.constraint), residual_.data(), jacobian_.data(), factor, sums);
}

double PoseFit::cost(const Fold& fold, const LinearizedPose& at) const {
  return fold.share * at.vision.cost + at.held.cost + fold.squared_weight * at.selected.cost;
}

Matrix6 PoseFit::normal(const Fold& fold, const LinearizedPose& at) const {
  double lower[PoseSums::kNormal];
  for (int k = 0; k < PoseSums::kNormal; ++k) {
    lower[k] = fold.share * at.vision.normal[k] + at.held.normal[k] +
               fold.squared_weight * at.selected.normal[k];
  }
  return unpacked(lower);
}

Vector6 PoseFit::gradient(const Fold& fold, const LinearizedPose& at) const {
  return fold.share * gradient_of(at.vision) + gradient_of(at.held) +
         fold.squared_weight * gradient_of(at.selected);
}

bool PoseFit::minimize(double weight, int max_iterations, LinearizedPose& at) {
  return descend({views_.inverse_sigma, 1.0 / count(), weight * weight}, max_iterations, at);
}

// Levenberg–Marquardt (thesis eq. 2.45), undamped until a step fails.
bool PoseFit::descend(const Fold& fold, int max_iterations, LinearizedPose& at) {
  double damping = 0.0;
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    Matrix6 damped = normal(fold, at);
    const Vector6 diagonal = damping * damped.diagonal(), downhill = gradient(fold, at);
    damped.diagonal() += diagonal;
    const Eigen::LLT<Matrix6> llt(damped);
    const Vector6 step = llt.solve(downhill);
    const double promise = step.dot(downhill) + step.dot(diagonal.cwiseProduct(step));
    const double now = cost(fold, at) + kNothing;
    if (llt.info() == Eigen::Success && promise <= kNegligible * now) return true;
    plus_pose(at.pose, step.data(), candidate_.pose);
    linearize(fold.inverse_sigma, candidate_);
    const bool succeeds = cost(fold, candidate_) < now || promise <= kRounding * now;
    if (llt.info() == Eigen::Success && succeeds) {
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
  const Fold all{views_.inverse_sigma, 1.0 / count(), weight * weight};
  const Vector6 g = gradient_of(minimum.selected);
  const Eigen::LLT<Matrix6> llt(normal(all, minimum));
  return llt.info() == Eigen::Success ? -4.0 * weight * weight * g.dot(llt.solve(g)) : 0.0;
}

int PoseFit::inliers(double inlier_px, const LinearizedPose& at) {
  kernels_.squared_errors(views_, intrinsics_, at.pose, errors_.data());
  int inliers = 0;
  for (int j = 0; j < count(); ++j) {
    const double bound = inlier_px * views_.inverse_sigma[j];
    inliers += errors_[j] <= bound * bound;
  }
  return inliers;
}

double PoseFit::leave_one_out(double weight, int fold_iterations, const LinearizedPose& minimum) {
  kernels_.rows(views_, intrinsics_, minimum.pose, rows_.data());
  const Fold fold{inverse_sigma_.data(), 1.0 / (count() - 1), weight * weight};
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
  const Fold fold{views_.inverse_sigma, 1.0 / (count() - 1), weight * weight};
  const Eigen::LLT<Matrix6> llt(normal(fold, minimum));
  if (llt.info() != Eigen::Success) return std::numeric_limits<double>::infinity();
  const Vector6 shift = llt.solve(gradient(fold, minimum));
  double whitener[PoseSums::kNormal];
  pack_whitener(llt, fold.share, whitener);
  kernels_.rows(views_, intrinsics_, minimum.pose, rows_.data());
  kernels_.predicted_errors(rows_.data(), views_.padded, whitener, shift.data(), errors_.data());
  double sum = 0.0;
  for (int j = 0; j < count(); ++j) sum += errors_[j];
  return sum / count();
}

}  // namespace sfmcpp::ba

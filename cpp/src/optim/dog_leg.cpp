#include <algorithm>
#include <cmath>
#include <optional>

#include "sfmcpp/linear/step_algebra.hpp"
#include "sfmcpp/optim/step_strategy.hpp"

namespace sfmcpp::optim {
namespace {

// μD is added to JᵀJ for the Gauss–Newton step, as a free gauge leaves it singular; more of it
// where that is not enough. With less, points that are weakly held along their rays fly off in one
// long step and do not come back: on BAL problem-49-7776 the cost ends 0.3 to 0.9 % above the best
// known with μ from 1e-12 to 1e-8, and 1e-5 above it with 1e-6, whatever the first radius.
constexpr double kRegularization = 1e-6;
constexpr double kMaxRegularization = 1.0;

// Γ₀ with D = I (Lourakis & Argyros 2005), and over the length of the first Cauchy step with
// D = diag(JᵀJ): there 10 came out best on BAL problems and synthetic scenes, 1 and 100 close by.
constexpr double kRadius = 1.0;
constexpr double kRadiusOverCauchyStep = 10.0;

// With a radius below this share of the Gauss–Newton step no unknown moves any more.
constexpr double kMinRadius = 1e-14;

// The path from the origin by the Cauchy step to the Gauss–Newton step (thesis eq. 2.43), of which
// the step is what lies within the radius. Both are kept until the state changes: a rejection costs
// no linear solve.
class DogLeg final : public StepStrategy {
 public:
  explicit DogLeg(const MinimizerOptions& options)
      : matrix_(options.damping_matrix),
        radius_(options.initial_radius),
        min_regularization_(options.initial_damping.value_or(kRegularization)),
        regularization_(min_regularization_) {}

  StepResult compute(const linear::NormalEquations& normal,
                     linear::LinearSolver& solver,
                     const std::function<bool()>& should_stop,
                     linear::Step& step) override {
    int iterations = 0;
    if (!has_path_) {
      set_cauchy_step(normal);
      has_path_ = set_gauss_newton_step(normal, solver, should_stop, iterations);
      if (!has_path_) return {.linear_solver_iterations = iterations};
      if (!radius_) radius_ = first_radius();
    }
    step = point_of_path(normal);
    step_norm_ = norm(normal, step, metric_);
    return {true, normal.model_decrease(step), iterations};
  }

  // Lourakis & Argyros 2005, as in the thesis.
  void accepted(double gain_ratio) override {
    has_path_ = false;
    if (gain_ratio > 0.75) radius_ = std::max(*radius_, 3.0 * step_norm_);
    if (gain_ratio < 0.25) *radius_ *= 0.5;
  }
  // A Gauss–Newton step well within the radius would only come again with half of it.
  void rejected() override {
    if (has_path_) radius_ = 0.5 * std::min(*radius_, step_norm_);
  }
  void moved() override { has_path_ = false; }
  bool can_retry() const override {
    return has_path_ && *radius_ > kMinRadius * gauss_newton_norm_;
  }

  // The path too, which a rejection leaves: to solve for it again would be at another μ.
  void keep(Archive& archive) override {
    archive.keep(radius_);
    archive.keep(regularization_);
    archive.keep(has_path_);
    if (!has_path_) return;
    for (linear::Step* step : {&metric_, &cauchy_, &gauss_newton_}) archive.keep(*step);
    for (double* length : {&cauchy_norm_, &gauss_newton_norm_, &step_norm_}) archive.keep(*length);
  }

 private:
  void set_cauchy_step(const linear::NormalEquations& normal) {
    metric_ = linear::damping_entries(normal, matrix_);
    const linear::Step gradient = linear::negative_gradient(normal);
    cauchy_ = divide(normal, gradient, metric_);
    scale(normal, dot(normal, cauchy_, gradient) / normal.curvature(cauchy_), cauchy_);
    cauchy_norm_ = norm(normal, cauchy_, metric_);
  }

  bool set_gauss_newton_step(const linear::NormalEquations& normal,
                             linear::LinearSolver& solver,
                             const std::function<bool()>& should_stop,
                             int& iterations) {
    do {
      const linear::Damping damping{regularization_, linear::DampingMatrix::kDiagonal};
      const linear::LinearSolveResult result = solver.solve(damping, gauss_newton_, should_stop);
      iterations += result.iterations;
      if (result.success) {
        gauss_newton_norm_ = norm(normal, gauss_newton_, metric_);
        regularization_ = std::max(0.1 * regularization_, min_regularization_);
        return true;
      }
      regularization_ *= 10.0;
    } while (regularization_ <= kMaxRegularization);
    return false;
  }

  double first_radius() const {
    return matrix_ == linear::DampingMatrix::kIdentity ? kRadius
                                                       : kRadiusOverCauchyStep * cauchy_norm_;
  }

  linear::Step point_of_path(const linear::NormalEquations& normal) const {
    if (gauss_newton_norm_ <= *radius_) return gauss_newton_;
    linear::Step step = cauchy_;
    if (cauchy_norm_ >= *radius_) {
      scale(normal, *radius_ / cauchy_norm_, step);
      return step;
    }
    linear::Step leg = gauss_newton_;
    add_scaled(normal, -1.0, cauchy_, leg);
    add_scaled(normal, share_of_leg(normal, leg), leg, step);
    return step;
  }

  // The t in [0, 1] with ‖δ_CAU + t (δ_GN − δ_CAU)‖ = Γ: the positive root of a t² + 2 b t + c with
  // c < 0 < a, without cancellation.
  double share_of_leg(const linear::NormalEquations& normal, const linear::Step& leg) const {
    const double a = dot(normal, leg, metric_, leg), b = dot(normal, cauchy_, metric_, leg);
    const double c = (cauchy_norm_ - *radius_) * (cauchy_norm_ + *radius_);
    const double root = std::sqrt(b * b - a * c);
    return b <= 0.0 ? (root - b) / a : -c / (root + b);
  }

  linear::DampingMatrix matrix_;
  std::optional<double> radius_;  // Γ
  double min_regularization_;
  double regularization_;  // μ
  bool has_path_ = false;
  linear::Step metric_, cauchy_, gauss_newton_;
  double cauchy_norm_ = 0.0, gauss_newton_norm_ = 0.0, step_norm_ = 0.0;
};

}  // namespace

std::unique_ptr<StepStrategy> make_dog_leg(const MinimizerOptions& options) {
  return std::make_unique<DogLeg>(options);
}

}  // namespace sfmcpp::optim

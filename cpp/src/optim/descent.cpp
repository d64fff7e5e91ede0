// Gradient descent and conjugate gradients: a rule gives the direction d, the quadratic model the
// length −slope/curvature along it, of which a step is a share that halves on failure and doubles,
// up to the whole, on success.
#include <algorithm>
#include <cmath>
#include <optional>

#include "sfmcpp/linear/block_diagonal.hpp"
#include "sfmcpp/linear/step_algebra.hpp"
#include "sfmcpp/optim/step_strategy.hpp"

namespace sfmcpp::optim {
namespace {

// With a share below this no unknown moves any more.
constexpr double kMinShare = 1e-14;

class DirectionRule {
 public:
  virtual ~DirectionRule() = default;
  // A direction of descent where the normal equations are now.
  virtual void next(const linear::NormalEquations& normal, linear::Step& direction) = 0;
  // Whether another direction follows from the same place.
  virtual bool has_another() const = 0;
  virtual void keep(Archive&) {}
};

// D⁻¹ b: with D = I the negative gradient.
class SteepestDescent final : public DirectionRule {
 public:
  explicit SteepestDescent(linear::DampingMatrix matrix) : matrix_(matrix) {}
  void next(const linear::NormalEquations& normal, linear::Step& direction) override {
    direction =
        divide(normal, linear::negative_gradient(normal), linear::damping_entries(normal, matrix_));
  }
  bool has_another() const override { return false; }

 private:
  linear::DampingMatrix matrix_;
};

// Polak–Ribière+ with the preconditioner M = blockdiag(JᵀJ) of the current place: with g = b and
// z = M⁻¹ g, d ← z + β d with β = max(0, zᵀ(g − g₋) / z₋ᵀg₋); from z again where d does not descend
// (Nocedal & Wright, eq. 5.44). The last direction is taken over as numbers: that its tangent space
// has turned a little is one more reason for β = 0 now and then.
class PolakRibiere final : public DirectionRule {
 public:
  void next(const linear::NormalEquations& normal, linear::Step& direction) override {
    const linear::Step gradient = linear::negative_gradient(normal);
    const linear::Step z = preconditioned(normal, gradient);
    const double zg = dot(normal, z, gradient);
    beta_ = last_zg_ ? std::max(0.0, (zg - dot(normal, z, last_gradient_)) / *last_zg_) : 0.0;
    if (beta_ > 0.0 && zg + beta_ * dot(normal, direction, gradient) <= 0.0) beta_ = 0.0;
    linear::Step last = std::move(direction);
    direction = z;
    if (beta_ > 0.0) add_scaled(normal, beta_, last, direction);
    last_gradient_ = gradient;
    last_zg_ = zg;
  }
  // The same gradient once more gives β = 0.
  bool has_another() const override { return beta_ > 0.0; }
  void keep(Archive& archive) override {
    archive.keep(last_gradient_);
    archive.keep(last_zg_);
    archive.keep(beta_);
  }

 private:
  linear::Step preconditioned(const linear::NormalEquations& normal, const linear::Step& g) {
    if (!blocks_) blocks_.emplace(normal);
    blocks_->factor({kPreconditionerDamping, linear::DampingMatrix::kDiagonal});
    linear::Step z;
    blocks_->solve(g, z);
    return z;
  }

  // Points seen from almost one place are weakly held along their rays.
  static constexpr double kPreconditionerDamping = 1e-6;

  std::optional<linear::BlockJacobi> blocks_;
  linear::Step last_gradient_;
  std::optional<double> last_zg_;
  double beta_ = 0.0;
};

class Descent final : public StepStrategy {
 public:
  explicit Descent(std::unique_ptr<DirectionRule> rule) : rule_(std::move(rule)) {}

  StepResult compute(const linear::NormalEquations& normal,
                     linear::LinearSolver&,
                     const std::function<bool()>&,
                     linear::Step& step) override {
    if (!has_direction_) set_direction(normal);
    step = direction_;
    scale(normal, share_ * length_, step);
    return {.valid = descends(), .predicted_decrease = share_ * (2.0 - share_) * whole_decrease_};
  }
  void accepted(double) override {
    has_direction_ = false;
    share_ = std::min(1.0, 2.0 * share_);
  }
  void rejected() override {
    has_direction_ = !rule_->has_another();
    share_ *= 0.5;
  }
  void moved() override { has_direction_ = false; }
  bool can_retry() const override { return descends() && share_ > kMinShare; }

  void keep(Archive& archive) override {
    rule_->keep(archive);
    archive.keep(direction_);
    archive.keep(has_direction_);
    archive.keep(length_);
    archive.keep(whole_decrease_);
    archive.keep(share_);
  }

 private:
  void set_direction(const linear::NormalEquations& normal) {
    rule_->next(normal, direction_);
    has_direction_ = true;
    const linear::Slopes slopes = normal.slopes(direction_);
    const double slope = slopes.camera + slopes.point;
    length_ = -slope / normal.curvature(direction_);
    whole_decrease_ = -0.5 * slope * length_;
  }
  bool descends() const { return std::isfinite(length_) && whole_decrease_ > 0.0; }

  std::unique_ptr<DirectionRule> rule_;
  linear::Step direction_;
  bool has_direction_ = false;
  double length_ = 0.0;          // where the model is least along the direction
  double whole_decrease_ = 0.0;  // of the model, there
  double share_ = 1.0;
};

}  // namespace

std::unique_ptr<StepStrategy> make_gradient_descent(const MinimizerOptions& options) {
  return std::make_unique<Descent>(std::make_unique<SteepestDescent>(options.damping_matrix));
}

std::unique_ptr<StepStrategy> make_conjugate_gradient(const MinimizerOptions&) {
  return std::make_unique<Descent>(std::make_unique<PolakRibiere>());
}

}  // namespace sfmcpp::optim

#include <algorithm>

#include "sfmcpp/optim/damping_rule.hpp"
#include "sfmcpp/optim/step_strategy.hpp"

namespace sfmcpp::optim {
namespace {

// Keeps λ a normal number over any run of successes.
constexpr double kMinLambda = 1e-16;

}  // namespace

void HartleyRule::accepted(double) { lambda_ = std::max(lambda_ / 10.0, kMinLambda); }

void HartleyRule::rejected() { lambda_ *= 10.0; }

void NielsenRule::accepted(double gain_ratio) {
  const double t = 2.0 * gain_ratio - 1.0;
  lambda_ = std::max(lambda_ * std::max(1.0 / 3.0, 1.0 - t * t * t), kMinLambda);
  growth_ = 2.0;
}

void NielsenRule::rejected() {
  lambda_ *= growth_;
  growth_ *= 2.0;
}

namespace {

class LevenbergMarquardt final : public StepStrategy {
 public:
  explicit LevenbergMarquardt(std::unique_ptr<DampingRule> rule) : rule_(std::move(rule)) {}

  StepResult compute(const linear::NormalEquations& normal,
                     linear::LinearSolver& solver,
                     const std::function<bool()>& should_stop,
                     linear::Step& step) override {
    if (!started_) rule_->start(normal);
    started_ = true;
    const linear::Damping damping = rule_->damping();
    const linear::LinearSolveResult result = solver.solve(damping, step, should_stop);
    if (!result.success) return {.linear_solver_iterations = result.iterations};
    return {true, normal.predicted_decrease(step, damping), result.iterations};
  }
  void accepted(double gain_ratio) override { rule_->accepted(gain_ratio); }
  void rejected() override { rule_->rejected(); }
  double damping() const override { return rule_->damping().lambda; }
  bool can_retry() const override { return damping() < kMaxLambda; }
  void keep(Archive& archive) override {
    archive.keep(started_);
    rule_->keep(archive);
  }

 private:
  std::unique_ptr<DampingRule> rule_;
  bool started_ = false;
};

std::unique_ptr<DampingRule> make_rule(const MinimizerOptions& options) {
  if (options.method == Method::kLevenbergMarquardt) {
    return std::make_unique<HartleyRule>(options.initial_damping.value_or(kHartleyStart),
                                         options.damping_matrix);
  }
  return std::make_unique<NielsenRule>(options.initial_damping.value_or(kNielsenStart),
                                       options.damping_matrix);
}

}  // namespace

std::unique_ptr<StepStrategy> make_levenberg_marquardt(const MinimizerOptions& options) {
  return std::make_unique<LevenbergMarquardt>(make_rule(options));
}

}  // namespace sfmcpp::optim

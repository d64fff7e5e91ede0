#include "sfmcpp/optim/step_strategy.hpp"

#include "sfmcpp/optim/damping_rule.hpp"

namespace sfmcpp::optim {
namespace {

// λ beyond this moves nothing any more.
constexpr double kMaxLambda = 1e32;

constexpr double kHartleyStart = 1e-3;
constexpr double kNielsenStart = 1e-4;

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

 private:
  std::unique_ptr<DampingRule> rule_;
  bool started_ = false;
};

// No damping: a step that does not decrease the cost ends the solve.
class GaussNewton final : public StepStrategy {
 public:
  StepResult compute(const linear::NormalEquations& normal,
                     linear::LinearSolver& solver,
                     const std::function<bool()>& should_stop,
                     linear::Step& step) override {
    const linear::Damping none{0.0, linear::DampingMatrix::kIdentity};
    const linear::LinearSolveResult result = solver.solve(none, step, should_stop);
    if (!result.success) return {.linear_solver_iterations = result.iterations};
    return {true, normal.predicted_decrease(step, none), result.iterations};
  }
  void accepted(double) override {}
  void rejected() override {}
  double damping() const override { return 0.0; }
  bool can_retry() const override { return false; }
};

}  // namespace

std::unique_ptr<StepStrategy> make_step_strategy(const MinimizerOptions& options) {
  switch (options.method) {
    case Method::kLevenbergMarquardt:
      return std::make_unique<LevenbergMarquardt>(std::make_unique<HartleyRule>(
          options.initial_damping.value_or(kHartleyStart), options.damping_matrix));
    case Method::kLevenbergMarquardtNielsen:
      return std::make_unique<LevenbergMarquardt>(std::make_unique<NielsenRule>(
          options.initial_damping.value_or(kNielsenStart), options.damping_matrix));
    case Method::kGaussNewton:
      return std::make_unique<GaussNewton>();
  }
  return nullptr;
}

}  // namespace sfmcpp::optim

#include "sfmcpp/optim/step_strategy.hpp"

namespace sfmcpp::optim {
namespace {

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
  bool can_retry() const override { return false; }
  void keep(Archive&) override {}
};

}  // namespace

std::unique_ptr<StepStrategy> make_gauss_newton(const MinimizerOptions&) {
  return std::make_unique<GaussNewton>();
}

}  // namespace sfmcpp::optim

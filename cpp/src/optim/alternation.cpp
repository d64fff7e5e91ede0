#include <optional>

#include "sfmcpp/linear/block_diagonal.hpp"
#include "sfmcpp/optim/damping_rule.hpp"
#include "sfmcpp/optim/step_strategy.hpp"

namespace sfmcpp::optim {
namespace {

// The decrease of a sweep (linear/block_diagonal.hpp) is that of the undamped model: no step solves
// the damped system.
class Alternation final : public StepStrategy {
 public:
  explicit Alternation(const MinimizerOptions& options)
      : rule_(options.initial_damping.value_or(kHartleyStart), options.damping_matrix) {}

  StepResult compute(const linear::NormalEquations& normal,
                     linear::LinearSolver&,
                     const std::function<bool()>&,
                     linear::Step& step) override {
    if (!blocks_) blocks_.emplace(normal);
    blocks_->factor(rule_.damping());
    blocks_->sweep(step);
    const double decrease = normal.model_decrease(step);
    return {.valid = decrease > 0.0, .predicted_decrease = decrease};
  }
  void accepted(double gain_ratio) override { rule_.accepted(gain_ratio); }
  void rejected() override { rule_.rejected(); }
  double damping() const override { return rule_.damping().lambda; }
  bool can_retry() const override { return damping() < kMaxLambda; }
  void keep(Archive& archive) override { rule_.keep(archive); }

 private:
  HartleyRule rule_;
  std::optional<linear::BlockJacobi> blocks_;
};

}  // namespace

std::unique_ptr<StepStrategy> make_alternation(const MinimizerOptions& options) {
  return std::make_unique<Alternation>(options);
}

}  // namespace sfmcpp::optim

// What a minimiser asks of a least-squares problem.
#pragma once

#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/optim/state.hpp"

namespace sfmcpp::optim {

class LeastSquaresModel {
 public:
  virtual ~LeastSquaresModel() = default;

  // ½ Σ ρ(‖r‖²); not finite where a residual is not.
  virtual double cost(const State& state) = 0;
  // Fills the normal equations at `state`.
  virtual void linearize(const State& state) = 0;
  virtual const linear::NormalEquations& normal_equations() const = 0;
  // `result` ← state + lengths ∘ step.
  virtual void plus(const State& state,
                    const linear::Step& step,
                    StepLengths lengths,
                    State& result) const = 0;
};

}  // namespace sfmcpp::optim

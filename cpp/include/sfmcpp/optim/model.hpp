// The interface of a least-squares problem to the minimiser.
#pragma once

#include <cmath>
#include <optional>
#include <span>

#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/linear/vector_algebra.hpp"
#include "sfmcpp/math/biquadratic.hpp"
#include "sfmcpp/optim/archive.hpp"
#include "sfmcpp/optim/state.hpp"

namespace sfmcpp::optim {

class LeastSquaresModel {
 public:
  virtual ~LeastSquaresModel() = default;

  // ½ Σ ρ(‖r‖²); not finite where a residual is not.
  virtual double cost(const State& state) = 0;
  // Fills the normal equations at `state`, and returns the cost there.
  virtual double linearize(const State& state) = 0;
  virtual const linear::NormalEquations& normal_equations() const = 0;
  // `result` ← state + lengths ∘ step.
  virtual void plus(const State& state,
                    const linear::Step& step,
                    StepLengths lengths,
                    State& result) const = 0;

  // The norm of all unknowns, over all ranks; steps are compared with it.
  virtual double size(const State& state) const {
    ThreadPool& pool = normal_equations().pool();
    return std::sqrt(linear::squared_norm(pool, state.cameras).value() +
                     linear::squared_norm(pool, state.intrinsics).value() +
                     normal_equations().exchange().sum(linear::squared_norm(pool, state.points)));
  }

  // Normalises in an accepted state what no residual depends on, such as the scale of homogeneous
  // coordinates; the cost stays as it is.
  virtual void normalize(State&) const {}

  // The derivative of the cost along `step` from `start`, where it has come to `candidate`. The
  // normal equations stay as they are. Only line searches that test slopes ask for it.
  virtual double slope(const State& start, const linear::Step& step, const State& candidate) = 0;

  // The second derivative of −r along α ↦ state + α step, for the residuals r of the observations
  // as the normal equations have them, which were filled at `state` last: two numbers each, until
  // the next call. Only the geodesic acceleration asks for it.
  virtual std::span<const double> bending(const State&, const linear::Step&) = 0;

  // The growth of all parts of the cost that grew from where the normal equations were filled to
  // the last cost(): large if a few unknowns spoil the step of the others.
  virtual double growth() const { return 0.0; }
  // Draws back such unknowns of the candidate of that cost() toward `start`, where the normal
  // equations were filled last, each until it costs no more than there; how many.
  virtual long hold_back(const State&, State&) { return 0; }
  // Fits unknowns of the candidate that `step`, from `start`, where the normal equations were
  // filled, has moved far and that are independent of each other given all others; how many.
  // `cost`: of the candidate.
  virtual long refit(const State& /*start*/,
                     const linear::Step&,
                     double /*cost*/,
                     State& /*candidate*/) {
    return 0;
  }

  // Intrinsics that a step has moved further than is plausible, while poses may still be far off.
  virtual bool moves_intrinsics_far(const State& /*start*/, const State& /*candidate*/) const {
    return false;
  }
  // Holds the intrinsics in the steps that follow, or frees them again.
  virtual void hold_intrinsics(bool) {}

  // Of a cost that is approached in stages (graduated non-convexity): goes on to the next stage
  // where `state` is good enough for that, or moves unknowns that the loss has rejected; whether it
  // has. The cost has changed then, and the normal equations must be filled anew.
  virtual bool sharpen(State&) { return false; }
  // Leaves a minimum for a stage of another cost, which may lead to a lower minimum, or goes back
  // to the one it left where it has not; whether it has.
  virtual bool leave(State&, double /*cost*/) { return false; }
  // Goes back to the minimum it left, where a run ends before it has come to another.
  virtual bool come_back(State&) { return false; }
  // Saves or restores the state of the last three.
  virtual void keep(Archive&) {}

  // The algebraic cost along `step` from `state`, where the normal equations were filled last; none
  // if the problem has no such cost.
  virtual std::optional<Biquadratic> algebraic_cost(const State&, const linear::Step&) {
    return std::nullopt;
  }
};

}  // namespace sfmcpp::optim

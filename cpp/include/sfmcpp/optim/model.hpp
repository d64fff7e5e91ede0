// What a minimiser asks of a least-squares problem.
#pragma once

#include <optional>

#include "sfmcpp/linear/normal_equations.hpp"
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

  // Takes out of an accepted state what no residual sees, such as the scale of homogeneous
  // coordinates; the cost stays as it is.
  virtual void normalize(State&) const {}

  // The derivative of the cost along `step` from `start`, where it has come to `candidate`. The
  // normal equations stay as they are. Only line searches that test slopes ask for it.
  virtual double slope(const State& start, const linear::Step& step, const State& candidate) = 0;

  // The second derivative of −r along α ↦ state + α step, for the residuals r of the observations
  // as the normal equations have them, which were filled at `state` last: two numbers each, until
  // the next call. Only the geodesic acceleration asks for it.
  virtual const std::vector<double>& bending(const State&, const linear::Step&) = 0;

  // What the parts of the cost that grew since the normal equations were filled have grown by at
  // the last cost(): much, if a few unknowns spoil the step of the others.
  virtual double growth() const { return 0.0; }
  // Draws back such unknowns of the candidate of that cost() toward `start`, where the normal
  // equations were filled last, each until it costs no more than there; how many.
  virtual long hold_back(const State&, State&) { return 0; }
  // Fits unknowns of the candidate that `step`, from where the normal equations were filled, has
  // moved far and that know nothing of each other, given all others; how many. `cost`: of the
  // candidate.
  virtual long refit(const linear::Step&, double /*cost*/, State& /*candidate*/) { return 0; }

  // Brings a cost that is to be approached in stages closer to the one that is meant, where `state`
  // is good enough for that, or moves what it has let go of; whether it has. The cost is another
  // one then, and the normal equations are to be filled anew.
  virtual bool sharpen(State&) { return false; }
  // Leaves a minimum for another stage, of a cost that may lead to a lower one, or goes back to the
  // one it left where it has not; whether it has.
  virtual bool leave(State&, double /*cost*/) { return false; }
  // Goes back to the minimum it left, where a run ends before it has come to another.
  virtual bool come_back(State&) { return false; }
  // Hands over what the last three have come to.
  virtual void keep(Archive&) {}

  // The algebraic cost along `step` from `state`, where the normal equations were filled last; none
  // if the problem has no such cost.
  virtual std::optional<Biquadratic> algebraic_cost(const State&, const linear::Step&) {
    return std::nullopt;
  }
};

}  // namespace sfmcpp::optim

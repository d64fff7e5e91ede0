// A bundle behind the minimiser's interface, with no more of it than every model has.
#pragma once

#include <vector>

#include "sfmcpp/ba/bundle_model.hpp"

namespace sfmcpp::support {

class ForwardingModel : public optim::LeastSquaresModel {
 public:
  explicit ForwardingModel(ba::BundleModel& model) : model_(model) {}

  double cost(const optim::State& state) override { return model_.cost(state); }
  double linearize(const optim::State& state) override { return model_.linearize(state); }
  const linear::NormalEquations& normal_equations() const override {
    return model_.normal_equations();
  }
  void plus(const optim::State& state,
            const linear::Step& step,
            optim::StepLengths lengths,
            optim::State& result) const override {
    model_.plus(state, step, lengths, result);
  }
  double slope(const optim::State& start,
               const linear::Step& step,
               const optim::State& candidate) override {
    return model_.slope(start, step, candidate);
  }
  std::span<const double> bending(const optim::State& state, const linear::Step& step) override {
    return model_.bending(state, step);
  }

 private:
  ba::BundleModel& model_;
};

}  // namespace sfmcpp::support

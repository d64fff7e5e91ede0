#include "sfmcpp/optim/damping_rule.hpp"

#include <algorithm>

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

}  // namespace sfmcpp::optim

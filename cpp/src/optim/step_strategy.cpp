#include "sfmcpp/optim/step_strategy.hpp"

#include "sfmcpp/optim/strategies.hpp"

namespace sfmcpp::optim {

std::unique_ptr<StepStrategy> make_step_strategy(const MinimizerOptions& options) {
  switch (options.method) {
    case Method::kLevenbergMarquardt:
    case Method::kLevenbergMarquardtNielsen:
      return make_levenberg_marquardt(options);
    case Method::kDogLeg:
      return make_dog_leg(options);
    case Method::kGaussNewton:
      return make_gauss_newton();
    case Method::kGradientDescent:
      return make_gradient_descent(options);
    case Method::kConjugateGradient:
      return make_conjugate_gradient(options);
    case Method::kAlternation:
      return make_alternation(options);
  }
  return nullptr;
}

}  // namespace sfmcpp::optim

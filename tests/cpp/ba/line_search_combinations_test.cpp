// Every method × line search × camera model is a way to the same minimum, and never goes up.
#include <cmath>

#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "support/all_models.hpp"
#include "support/enumerators.hpp"
#include "support/small_scenes.hpp"

namespace sfmcpp::ba::line_search_combinations_test {
namespace {

using optim::LineSearchKind;
using optim::Method;
using optim::State;
using support::OwnedProblem;

using Combination = std::tuple<CameraModelId, Method>;

SolveSummary solved(const OwnedProblem& scene, const SolveOptions& options) {
  State state = state_of(scene.view());
  return solve(scene.view(), options, {}, state);
}

// Searched at every iteration, on rejected steps too.
SolveOptions options_for(Method method, LineSearchKind search) {
  SolveOptions options;
  options.minimizer.method = method;
  options.minimizer.termination.function_tolerance = 1e-14;
  options.minimizer.termination.max_iterations = 200;
  options.minimizer.line_search.kind = search;
  if (search != LineSearchKind::kNone) options.minimizer.line_search.iterations = 1000;
  return options;
}

std::vector<LineSearchKind> all_searches() {
  std::vector<LineSearchKind> searches;
  for (const auto& [search, name] : EnumNames<LineSearchKind>::kTable) searches.push_back(search);
  return searches;
}

class MethodAndModel : public testing::TestWithParam<Combination> {
 protected:
  OwnedProblem scene = [] {
    support::SceneOptions options = support::perturbed(std::get<0>(GetParam()));
    options.varied_sigma = true;
    return make_circle_scene(options);
  }();
  Method method = std::get<1>(GetParam());
};

TEST_P(MethodAndModel, ReachesTheSameMinimumWithEveryLineSearch) {
  const double expected =
      solved(scene, options_for(Method::kLevenbergMarquardt, LineSearchKind::kNone))
          .minimizer.final_cost;
  for (LineSearchKind search : all_searches()) {
    const SolveSummary summary = solved(scene, options_for(method, search));
    EXPECT_EQ(summary.minimizer.termination, optim::Termination::kConverged) << enum_name(search);
    EXPECT_LT(summary.minimizer.final_cost, 0.1 * summary.minimizer.initial_cost);
    EXPECT_NEAR(summary.minimizer.final_cost / expected, 1.0, 1e-8) << enum_name(search);
  }
}

std::vector<Combination> combinations(const std::vector<Method>& methods) {
  std::vector<Combination> result;
  for (CameraModelId model : support::all_models()) {
    for (Method method : methods) {
      if (is_metric(model) || method != Method::kGaussNewton) result.emplace_back(model, method);
    }
  }
  return result;
}

std::string name_of(const testing::TestParamInfo<Combination>& test) {
  return support::identifier_of(std::get<0>(test.param), std::get<1>(test.param));
}

INSTANTIATE_TEST_SUITE_P(SecondOrder,
                         MethodAndModel,
                         testing::ValuesIn(combinations({Method::kLevenbergMarquardt,
                                                         Method::kLevenbergMarquardtNielsen,
                                                         Method::kDogLeg,
                                                         Method::kGaussNewton})),
                         name_of);

// Methods that converge too slowly to be waited for.
class SlowMethodAndModel : public MethodAndModel {};

TEST_P(SlowMethodAndModel, GoesDownAndNeverUpWithEveryLineSearch) {
  for (LineSearchKind search : all_searches()) {
    SolveOptions options = options_for(method, search);
    options.minimizer.termination.max_iterations = 30;
    const SolveSummary summary = solved(scene, options);
    const auto& iterations = summary.minimizer.iterations;
    for (std::size_t k = 1; k < iterations.size(); ++k) {
      EXPECT_LE(iterations[k].cost, iterations[k - 1].cost);
      EXPECT_EQ(iterations[k].accepted, iterations[k].cost < iterations[k - 1].cost);
    }
    EXPECT_LT(summary.minimizer.final_cost, 0.5 * summary.minimizer.initial_cost)
        << enum_name(search);
  }
}

INSTANTIATE_TEST_SUITE_P(FirstOrder,
                         SlowMethodAndModel,
                         testing::ValuesIn(combinations({Method::kGradientDescent,
                                                         Method::kConjugateGradient,
                                                         Method::kAlternation})),
                         name_of);

}  // namespace
}  // namespace sfmcpp::ba::line_search_combinations_test

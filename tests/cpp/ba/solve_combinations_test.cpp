// Every method × linear solver × loss is a way to the same minimum.
#include <cmath>

#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "sfmcpp/core/error.hpp"
#include "support/small_scenes.hpp"

namespace sfmcpp::ba {
namespace {

using linear::LinearSolverKind;
using optim::Method;
using optim::State;
using support::OwnedProblem;

OwnedProblem scene() {
  support::SceneOptions options = support::perturbed(CameraModelId::kPerspective);
  options.num_groups = 2;
  options.varied_sigma = true;
  return make_circle_scene(options);
}

SolveOptions options_for(Method method, LinearSolverKind solver, LossKind loss) {
  SolveOptions options;
  options.minimizer.method = method;
  options.minimizer.termination.function_tolerance = 1e-14;
  options.minimizer.termination.max_iterations = 200;
  options.linear_solver.kind = solver;
  options.linear_solver.pcg_tolerance = 1e-8;
  options.linear_solver.pcg_max_iterations = 5000;
  options.loss = loss;
  options.loss_scale_px = 2.0;
  return options;
}

// The minimum next to the squared loss' one, so that Tukey's other minima play no part.
State near_the_minimum(const OwnedProblem& problem) {
  State state = state_of(problem.view());
  SolveOptions options =
      options_for(Method::kLevenbergMarquardt, LinearSolverKind::kDense, LossKind::kSquared);
  options.minimizer.termination.function_tolerance = 1e-3;
  solve(problem.view(), options, {}, state);
  return state;
}

using Combination = std::tuple<Method, LinearSolverKind, LossKind>;

class EveryCombination : public testing::TestWithParam<Combination> {};

TEST_P(EveryCombination, ReachesTheSameMinimum) {
  const auto& [method, solver, loss] = GetParam();
  const OwnedProblem problem = scene();
  const State start = near_the_minimum(problem);
  State reference = start, state = start;
  const double expected =
      solve(problem.view(),
            options_for(Method::kLevenbergMarquardt, LinearSolverKind::kDense, loss),
            {},
            reference)
          .minimizer.final_cost;
  const SolveSummary summary = solve(problem.view(), options_for(method, solver, loss), {}, state);
  EXPECT_EQ(summary.minimizer.termination, optim::Termination::kConverged);
  EXPECT_EQ(summary.linear_solver.kind, solver);
  EXPECT_LT(expected, summary.minimizer.initial_cost);
  EXPECT_NEAR(summary.minimizer.final_cost / expected, 1.0, 1e-8);
}

INSTANTIATE_TEST_SUITE_P(All,
                         EveryCombination,
                         testing::Combine(testing::Values(Method::kLevenbergMarquardt,
                                                          Method::kLevenbergMarquardtNielsen,
                                                          Method::kGaussNewton),
                                          testing::Values(LinearSolverKind::kDense,
                                                          LinearSolverKind::kSparse,
                                                          LinearSolverKind::kIterative),
                                          testing::Values(LossKind::kSquared,
                                                          LossKind::kHuber,
                                                          LossKind::kCauchy,
                                                          LossKind::kTukey)),
                         [](const auto& test) {
                           std::string name(enum_name(std::get<0>(test.param)));
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name + "_" + std::string(enum_name(std::get<1>(test.param))) +
                                  "_" + std::string(enum_name(std::get<2>(test.param)));
                         });

TEST(Solve, GaussNewtonWithAFreeGaugeIsRefused) {
  const OwnedProblem problem = scene();
  State state = state_of(problem.view());
  SolveOptions options;
  options.minimizer.method = Method::kGaussNewton;
  options.gauge = Gauge::kFree;
  EXPECT_THROW(solve(problem.view(), options, {}, state), InvalidArgument);
}

TEST(Solve, ABrokenProblemIsRefusedBeforeTheStateIsTouched) {
  OwnedProblem problem = scene();
  problem.sigma_px[3] = -1.0;
  State state = state_of(problem.view());
  const State before = state;
  EXPECT_THROW(solve(problem.view(), {}, {}, state), InvalidArgument);
  problem.sigma_px[3] = 1.0;
  problem.point_index[1] = problem.point_index[0];
  problem.camera_index[1] = problem.camera_index[0];
  EXPECT_THROW(solve(problem.view(), {}, {}, state), InvalidArgument);
  EXPECT_EQ(state.cameras, before.cameras);
}

}  // namespace
}  // namespace sfmcpp::ba

// Every method × linear solver × loss × camera model is a way to the same minimum.
#include <map>

#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "sfmcpp/core/error.hpp"
#include "support/all_models.hpp"
#include "support/enumerators.hpp"
#include "support/small_scenes.hpp"

namespace sfmcpp::ba::solve_combinations_test {
namespace {

using linear::LinearSolverKind;
using optim::Method;
using optim::State;
using support::OwnedProblem;

OwnedProblem scene(CameraModelId model = CameraModelId::kPerspective) {
  support::SceneOptions options = support::perturbed(model);
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
  if (solver == LinearSolverKind::kIterative) {
    options.linear_solver.pcg_tolerance = 1e-8;
    options.linear_solver.pcg_max_iterations = 5000;
  }
  options.loss = loss;
  if (loss != LossKind::kSquared) options.loss_scale_px = 2.0;
  return options;
}

// A minimum, and a start so near that Tukey's other minima play no part.
struct Valley {
  OwnedProblem problem;
  State start;
  double minimum = 0.0;
};

Valley make_valley(CameraModelId model, LossKind loss) {
  Valley valley{scene(model), {}};
  const Problem problem = valley.problem.view();
  valley.start = state_of(problem);
  SolveOptions options =
      options_for(Method::kLevenbergMarquardt, LinearSolverKind::kDense, LossKind::kSquared);
  options.minimizer.termination.function_tolerance = 1e-3;
  solve(problem, options, {}, valley.start);
  State state = valley.start;
  valley.minimum = solve(problem,
                         options_for(Method::kLevenbergMarquardt, LinearSolverKind::kDense, loss),
                         {},
                         state)
                       .minimizer.final_cost;
  return valley;
}

const Valley& valley_of(CameraModelId model, LossKind loss) {
  static std::map<std::pair<CameraModelId, LossKind>, Valley> known;
  const auto [entry, is_new] = known.try_emplace({model, loss});
  if (is_new) entry->second = make_valley(model, loss);
  return entry->second;
}

bool solves_a_system(Method method) { return facts_of(method).solves_linear_system; }

bool is_legal(CameraModelId model, Method method, LinearSolverKind solver) {
  if (facts_of(method).needs_fixed_gauge() && !is_metric(model)) return false;
  return solves_a_system(method) == (solver != LinearSolverKind::kAuto);
}

using Combination = std::tuple<CameraModelId, Method, LinearSolverKind, LossKind>;

std::vector<Combination> every_combination() {
  std::vector<Combination> combinations;
  for (CameraModelId model : support::all_models()) {
    for (const auto& [method, method_name] : EnumNames<Method>::kTable) {
      for (const auto& [solver, solver_name] : EnumNames<LinearSolverKind>::kTable) {
        if (!is_legal(model, method, solver)) continue;
        for (const auto& [loss, loss_name] : EnumNames<LossKind>::kTable)
          combinations.emplace_back(model, method, solver, loss);
      }
    }
  }
  return combinations;
}

class EveryCombination : public testing::TestWithParam<Combination> {};

// Methods without a system have a long way: they go a good part of it, downhill at every step.
TEST_P(EveryCombination, ReachesTheSameMinimum) {
  const auto& [model, method, solver, loss] = GetParam();
  const Valley& valley = valley_of(model, loss);
  SolveOptions options = options_for(method, solver, loss);
  if (!solves_a_system(method)) options.minimizer.termination.max_iterations = 30;
  State state = valley.start;
  const SolveSummary summary = solve(valley.problem.view(), options, {}, state);
  const double start = summary.minimizer.initial_cost, end = summary.minimizer.final_cost;
  EXPECT_LT(valley.minimum, start);
  if (solves_a_system(method)) {
    EXPECT_EQ(summary.minimizer.termination, optim::Termination::kConverged);
    EXPECT_EQ(summary.linear_solver.kind, solver);
    EXPECT_NEAR(end / valley.minimum, 1.0, 1e-8);
  } else {
    EXPECT_GT(end / valley.minimum, 1.0 - 1e-8);
    EXPECT_LT(end - valley.minimum, 0.8 * (start - valley.minimum));
  }
}

std::string name_of(const testing::TestParamInfo<Combination>& test) {
  const auto& [model, method, solver, loss] = test.param;
  return support::identifier_of(model, method, solver, loss);
}

INSTANTIATE_TEST_SUITE_P(All, EveryCombination, testing::ValuesIn(every_combination()), name_of);

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
}  // namespace sfmcpp::ba::solve_combinations_test

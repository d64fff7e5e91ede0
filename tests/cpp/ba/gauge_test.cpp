// The fixed gauge takes exactly the freedom that is left: the minimum stays where it is.
#include "sfmcpp/ba/gauge.hpp"

#include <algorithm>
#include <functional>
#include <ostream>

#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "support/linearized_problem.hpp"

namespace sfmcpp::ba::gauge_test {
namespace {

using support::OwnedProblem;

OwnedProblem scene() { return make_circle_scene(support::perturbed(CameraModelId::kCalibrated)); }

std::vector<PoseParameter> gauge_of(const OwnedProblem& problem) {
  const Problem p = problem.view();
  return choose_gauge(p, graph_of(p), state_of(p));
}

double cost_with(const OwnedProblem& problem, Gauge gauge) {
  SolveOptions options;
  options.gauge = gauge;
  options.minimizer.termination.function_tolerance = 1e-14;
  options.minimizer.termination.max_iterations = 200;
  optim::State state = state_of(problem.view());
  return solve(problem.view(), options, {}, state).minimizer.final_cost;
}

// What is fixed, and how many degrees of freedom of a similarity that leaves.
struct Case {
  const char* name;
  std::vector<int> cameras, points;
  std::size_t freedom;
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

class GaugeLeft : public testing::TestWithParam<Case> {
 protected:
  GaugeLeft() {
    for (int i : GetParam().cameras) problem.fixed_cameras[i] = 1;
    for (int p : GetParam().points) problem.fixed_points[p] = 1;
  }
  OwnedProblem problem = scene();
};

TEST_P(GaugeLeft, AsManyParametersAreHeldAsThereIsFreedom) {
  const std::vector<PoseParameter> held = gauge_of(problem);
  EXPECT_EQ(held.size(), GetParam().freedom);
  EXPECT_EQ(std::adjacent_find(held.begin(), held.end()), held.end());
  for (const PoseParameter& parameter : held) EXPECT_FALSE(problem.fixed_cameras[parameter.camera]);
}

TEST_P(GaugeLeft, CostAtTheMinimumIsThatWithTheGaugeFree) {
  EXPECT_NEAR(cost_with(problem, Gauge::kFixed) / cost_with(problem, Gauge::kFree), 1.0, 1e-9);
}

INSTANTIATE_TEST_SUITE_P(Fixed,
                         GaugeLeft,
                         testing::Values(Case{"Nothing", {}, {}, 7},
                                         Case{"OneCamera", {4}, {}, 1},
                                         Case{"TwoCameras", {1, 2}, {}, 0},
                                         Case{"OnePoint", {}, {0}, 4},
                                         Case{"TwoPoints", {}, {0, 1}, 1},
                                         Case{"ThreePoints", {}, {0, 1, 2}, 0},
                                         Case{"CameraAndPoint", {0}, {0}, 0},
                                         Case{"Much", {0, 3, 5}, {0, 7, 8}, 0}),
                         [](const auto& test) { return std::string(test.param.name); });

TEST(ChooseGauge, FixedThingsThatNobodySeesHoldNothing) {
  OwnedProblem problem = scene();
  for (int k = 0; k < 3; ++k) {
    problem.points.insert(problem.points.end(), {1.0 * k, 2.0, 0.5 * k * k});
    problem.fixed_points.push_back(1);
  }
  EXPECT_EQ(gauge_of(problem).size(), 7u);
}

TEST(ChooseGauge, ThreePointsOnALineLeaveTheTurnAboutIt) {
  OwnedProblem problem = scene();
  for (int p = 0; p < 3; ++p) {
    problem.fixed_points[p] = 1;
    for (int k = 0; k < 3; ++k) problem.points[3 * p + k] = (1.0 + p) * (0.5 - k);
  }
  EXPECT_EQ(gauge_of(problem).size(), 1u);
}

TEST(ChooseGauge, IsThatOfTheShapeNotOfItsSizeAndPlace) {
  const OwnedProblem problem = scene();
  OwnedProblem far = problem;
  for (std::size_t k = 0; k < far.cameras.size(); ++k) {
    if (k % 4 == 3) far.cameras[k] = 1e-3 * far.cameras[k] + 50.0;
  }
  EXPECT_EQ(gauge_of(far), gauge_of(problem));
}

// The arrays of the problem were a start once; the state is where the solve begins.
TEST(Solve, TakesTheGaugeOfItsStateNotOfTheArraysOfTheProblem) {
  const OwnedProblem problem = scene();
  OwnedProblem stale = problem;  // its longest baseline is along y instead of x
  for (std::size_t k = 0; k < stale.cameras.size(); k += 12)
    std::swap(stale.cameras[k + 3], stale.cameras[k + 7]);
  EXPECT_NE(gauge_of(stale), gauge_of(problem));
  SolveOptions options;
  options.gauge = Gauge::kFixed;
  optim::State expected = state_of(problem.view()), state = expected;
  solve(problem.view(), options, {}, expected);
  solve(stale.view(), options, {}, state);
  EXPECT_EQ(state.cameras, expected.cameras);
  EXPECT_EQ(state.points, expected.points);
}

}  // namespace
}  // namespace sfmcpp::ba::gauge_test

namespace sfmcpp::ba::gauge_conditioning_test {
namespace {

// Camera 3 is fixed and camera 1, the first free one, is opposite: their centres differ by 20 m in
// y, in x by the error of the start alone. A scale held through x is a constraint, no gauge.
TEST(ChooseGauge, HoldsTheScaleThroughALongCoordinateOfABaseline) {
  for (unsigned seed = 1; seed <= 12; ++seed) {
    support::SceneOptions options = support::perturbed(CameraModelId::kCalibrated);
    options.num_cameras = 4;
    options.seed = seed;
    const support::OwnedProblem all = make_circle_scene(options);
    support::OwnedProblem scene = all;
    scene.camera_index.clear();
    scene.point_index.clear();
    scene.pixels.clear();
    for (std::size_t k = 0; k < all.camera_index.size(); ++k) {
      if (all.camera_index[k] == 0) continue;  // not observed
      scene.observe(
          all.camera_index[k], all.point_index[k], all.pixels[2 * k], all.pixels[2 * k + 1]);
    }
    scene.fixed_cameras[3] = 1;
    double costs[2];
    for (int k = 0; k < 2; ++k) {
      SolveOptions solve_options;
      solve_options.gauge = k == 0 ? Gauge::kFree : Gauge::kFixed;
      solve_options.minimizer.termination.function_tolerance = 1e-14;
      solve_options.minimizer.termination.max_iterations = 500;
      optim::State state = state_of(scene.view());
      costs[k] = solve(scene.view(), solve_options, {}, state).minimizer.final_cost;
    }
    EXPECT_NEAR(costs[1] / costs[0], 1.0, 1e-9) << "seed " << seed;
  }
}

}  // namespace
}  // namespace sfmcpp::ba::gauge_conditioning_test

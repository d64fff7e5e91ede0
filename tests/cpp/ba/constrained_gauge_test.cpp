// Constraints hold their part of the gauge: a fixed gauge takes what they leave, and moves no
// minimum.
#include <ostream>

#include <gtest/gtest.h>

#include "sfmcpp/ba/gauge.hpp"
#include "sfmcpp/ba/solve.hpp"
#include "support/random_constraints.hpp"

namespace sfmcpp::ba::constrained_gauge_test {
namespace {

using support::OwnedProblem;
using Kind = residuals::ConstraintKind;

OwnedProblem scene(bool on_a_line = false) {
  support::SceneOptions options = support::perturbed(CameraModelId::kPerspective);
  OwnedProblem problem = make_circle_scene(options);
  for (int i = 0; on_a_line && i < options.num_cameras; ++i) {
    for (int k = 0; k < 3; ++k) problem.cameras[12 * i + 4 * k + 3] = 2.0 + (k + 1.0) * i;
  }
  return problem;
}

struct Case {
  const char* name;
  residuals::ConstraintKind kind;
  std::vector<std::pair<int, int>> cameras;
  std::size_t freedom;
  bool on_a_line = false;
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

class ConstrainedGauge : public testing::TestWithParam<Case> {
 protected:
  ConstrainedGauge() {
    problem.constraints.add(random_group(problem, GetParam().kind, GetParam().cameras));
  }
  std::size_t held() const {
    const Problem p = problem.view();
    return choose_gauge(p, graph_of(p), state_of(p)).size();
  }
  double minimum(Gauge gauge) const {
    SolveOptions options;
    options.gauge = gauge;
    options.minimizer.termination.function_tolerance = 1e-14;
    options.minimizer.termination.max_iterations = 500;
    optim::State state = state_of(problem.view());
    return solve(problem.view(), options, {}, state).minimizer.final_cost;
  }
  OwnedProblem problem = scene(GetParam().on_a_line);
};

TEST_P(ConstrainedGauge, HoldsTheFreedomThatConstraintsLeave) {
  EXPECT_EQ(held(), GetParam().freedom);
}

TEST_P(ConstrainedGauge, DoesNotDependOnTheWeightUnlessItIsZero) {
  for (double weight : {1e-6, 1e12}) {
    problem.constraints.set_weight(problem.constraints.groups()[0].name, weight);
    EXPECT_EQ(held(), GetParam().freedom);
  }
  problem.constraints.set_weight(problem.constraints.groups()[0].name, 0.0);
  EXPECT_EQ(held(), 7u);
}

TEST_P(ConstrainedGauge, MovesNoMinimum) {
  if (GetParam().on_a_line) return;  // such a start has nothing to do with the images
  const double free = minimum(Gauge::kFree), fixed = minimum(Gauge::kFixed);
  EXPECT_NEAR(fixed / free, 1.0, 1e-6);
}

const std::vector<std::pair<int, int>> kThree{{0, 1}, {1, 3}, {2, 5}};

INSTANTIATE_TEST_SUITE_P(
    Kinds,
    ConstrainedGauge,
    testing::Values(Case{"Pose", Kind::kPose, {{0, 1}}, 1},
                    Case{"TwoPoses", Kind::kPose, {{0, 1}, {0, 2}}, 0},
                    Case{"OnePosition", Kind::kPosition, {{0, 1}}, 4},
                    Case{"TwoPositions", Kind::kPosition, {{0, 1}, {0, 3}}, 1},
                    Case{"ThreePositions", Kind::kPosition, kThree, 0},
                    Case{"ThreePositionsOnALine", Kind::kPosition, kThree, 1, true},
                    Case{"Orientation", Kind::kOrientation, kThree, 4},
                    Case{"DisplacementPose", Kind::kDisplacementPose, kThree, 6},
                    Case{"DisplacementTranslation", Kind::kDisplacementTranslation, kThree, 3},
                    Case{"DisplacementRotation", Kind::kDisplacementRotation, kThree, 7},
                    Case{"DisplacementRotationLog", Kind::kDisplacementRotationLog, kThree, 7},
                    Case{"Scale", Kind::kScale, kThree, 6},
                    Case{"Focal", Kind::kFocal, kThree, 7}),
    [](const auto& test) { return std::string(test.param.name); });

TEST(ConstrainedGauge, FixedCamerasAndConstraintsHoldTogether) {
  OwnedProblem problem = scene();
  problem.fixed_cameras[2] = 1;
  problem.constraints.add(random_group(problem, Kind::kScale, {{2, 4}}));
  const Problem p = problem.view();
  EXPECT_EQ(choose_gauge(p, graph_of(p), state_of(p)).size(), 0u);
}

TEST(ConstrainedGauge, GaussNewtonLeavesToPositionsWhatTheyHold) {
  OwnedProblem problem = scene();
  problem.constraints.add(random_group(problem, Kind::kPosition, kThree));
  double costs[2];
  for (int k = 0; k < 2; ++k) {
    SolveOptions options;
    options.minimizer.method =
        k == 0 ? optim::Method::kGaussNewton : optim::Method::kLevenbergMarquardt;
    options.minimizer.termination.function_tolerance = 1e-14;
    options.minimizer.termination.max_iterations = 200;
    optim::State state = state_of(problem.view());
    costs[k] = solve(problem.view(), options, {}, state).minimizer.final_cost;
  }
  EXPECT_NEAR(costs[0] / costs[1], 1.0, 1e-8);
}

}  // namespace
}  // namespace sfmcpp::ba::constrained_gauge_test

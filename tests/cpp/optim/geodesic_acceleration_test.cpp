#include "sfmcpp/optim/geodesic_acceleration.hpp"

#include <gtest/gtest.h>

#include "sfmcpp/optim/minimizer.hpp"
#include "support/linearized_problem.hpp"

namespace sfmcpp::optim::geodesic_acceleration_test {
namespace {

MinimizerOptions with(Acceleration kind) {
  MinimizerOptions options;
  options.acceleration = kind;
  return options;
}

TEST(GeodesicAcceleration, AutoLeavesOtherMethodsAndLineSearchesAlone) {
  MinimizerOptions options = with(Acceleration::kAuto);
  EXPECT_TRUE(GeodesicAcceleration(options).is_possible());
  options.method = Method::kDogLeg;
  EXPECT_FALSE(GeodesicAcceleration(options).is_possible());
  options.method = Method::kLevenbergMarquardt;
  options.line_search.kind = LineSearchKind::kGlobalAlgebraic;
  EXPECT_FALSE(GeodesicAcceleration(options).is_possible());
}

class AcceleratedMinimiser : public testing::TestWithParam<CameraModelId> {
 protected:
  // Exact observations, from a start so far off that residuals bend.
  static support::SceneOptions exact() {
    support::SceneOptions scene = support::perturbed(GetParam());
    scene.noise_px = 0.0;
    scene.point_error_m *= 3.0;
    return scene;
  }
  MinimizerSummary run(Acceleration kind) {
    support::LinearizedProblem work{make_circle_scene(exact())};
    MinimizerOptions options = with(kind);
    options.termination.function_tolerance = 1e-12;
    const auto solver =
        linear::make_linear_solver(work.normal(), {linear::LinearSolverKind::kDense});
    const Stopwatch clock;
    return minimize(work.model, *solver, options, {}, clock, work.state);
  }
  // Steps until the cost is a millionth of the first.
  static int steps(const MinimizerSummary& summary) {
    for (const Iteration& now : summary.iterations) {
      if (now.cost < 1e-6 * summary.initial_cost) return now.number;
    }
    return 1000;
  }
};

TEST_P(AcceleratedMinimiser, ComesToTheExactSolutionInNoMoreSteps) {
  const int straight = steps(run(Acceleration::kNone));
  EXPECT_LT(straight, 1000);
  for (Acceleration kind : {Acceleration::kAuto, Acceleration::kPoints, Acceleration::kGeodesic}) {
    const MinimizerSummary summary = run(kind);
    EXPECT_LE(steps(summary), straight) << enum_name(kind);
    EXPECT_LT(summary.final_cost, 1e-10 * summary.initial_cost) << enum_name(kind);
    int accelerated = 0;
    for (const Iteration& now : summary.iterations) accelerated += now.accelerated;
    EXPECT_GT(accelerated, 0) << enum_name(kind);
  }
}

INSTANTIATE_TEST_SUITE_P(Models,
                         AcceleratedMinimiser,
                         testing::Values(CameraModelId::kCalibrated,
                                         CameraModelId::kBal,
                                         CameraModelId::kPerspective),
                         [](const auto& test) { return std::string(enum_name(test.param)); });

}  // namespace
}  // namespace sfmcpp::optim::geodesic_acceleration_test

#include <gtest/gtest.h>

#include "sfmcpp/ba/gauge.hpp"
#include "sfmcpp/ba/solve.hpp"
#include "support/linearized_problem.hpp"

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

// A Jacobian stored in single precision leads to the minimum of one in double precision.
#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "support/all_models.hpp"
#include "support/small_scenes.hpp"

namespace sfmcpp::ba::precision_test {
namespace {

using linear::Precision;
using support::OwnedProblem;

SolveSummary solved(const OwnedProblem& scene, Precision precision) {
  SolveOptions options;
  options.precision = precision;
  options.minimizer.termination.function_tolerance = 1e-12;
  optim::State state = state_of(scene.view());
  return solve(scene.view(), options, {}, state);
}

class StoredPrecision : public testing::TestWithParam<CameraModelId> {};

TEST_P(StoredPrecision, SingleReachesTheMinimumOfDouble) {
  support::SceneOptions options = support::perturbed(GetParam());
  options.noise_px = 0.7;
  const OwnedProblem scene = make_circle_scene(options);
  const double single = solved(scene, Precision::kSingle).minimizer.final_cost;
  const double both = solved(scene, Precision::kDouble).minimizer.final_cost;
  EXPECT_NEAR(single / both, 1.0, 1e-9);
}

// Residuals are rounded relative to themselves, so nothing keeps them from vanishing; with J
// rounded the last steps gain seven digits each and not twice as many, so that runs end a step
// earlier.
TEST_P(StoredPrecision, SingleFitsExactDataAsWell) {
  support::SceneOptions options = support::perturbed(GetParam());
  options.noise_px = 0.0;
  EXPECT_LT(solved(make_circle_scene(options), Precision::kSingle).final_rms_px, 1e-6);
}

INSTANTIATE_TEST_SUITE_P(Models,
                         StoredPrecision,
                         testing::ValuesIn(support::all_models()),
                         support::name_of_model);

TEST(StoredPrecisionChoice, GoesByTheNumberOfObservationsAlone) {
  EXPECT_EQ(linear::choose_precision(Precision::kAuto, 1e3), Precision::kDouble);
  EXPECT_EQ(linear::choose_precision(Precision::kAuto, 1e7), Precision::kSingle);
  for (Precision asked : {Precision::kSingle, Precision::kDouble}) {
    EXPECT_EQ(linear::choose_precision(asked, 1e3), asked);
    EXPECT_EQ(linear::choose_precision(asked, 1e7), asked);
  }
}

}  // namespace
}  // namespace sfmcpp::ba::precision_test

// Batched pose fits against dense fits with numeric derivatives, for every kind of constraint.
#include "sfmcpp/ba/pose_refinement.hpp"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "support/pose_scene.hpp"

namespace sfmcpp::pose_refinement_test {
namespace {

using ba::PoseSweep;
using support::dense_fit;
using support::distance;
using support::Pose;
using support::refitted_score;
using support::stacked;
using Kind = residuals::ConstraintKind;
using Scene = support::PoseScene;

const std::vector<double> kWeights{0.0, 0.01, 0.3, 3.0, 30.0, 1000.0};

class PoseFitWith : public testing::TestWithParam<Kind> {};

TEST_P(PoseFitWith, EveryWeightHasThePoseOfADenseFit) {
  const Scene s(GetParam());
  const PoseSweep sweep = s.sweep(kWeights);
  for (std::size_t k = 0; k < kWeights.size(); ++k) {
    const Pose expected = dense_fit(s, {kWeights[k]}, s.start);
    EXPECT_LT(distance(sweep.poses.data() + 12 * k, expected.data()), 2e-8) << kWeights[k];
    EXPECT_TRUE(sweep.converged[k]);
    const double cost = stacked(s, {kWeights[k]}, expected).squaredNorm();
    const double swept = sweep.vision[k] + std::pow(kWeights[k], 2) * sweep.constraint[k];
    EXPECT_NEAR(swept, cost, 1e-9 * cost);
    EXPECT_NEAR(sweep.vision[k], stacked(s, {0.0}, expected).squaredNorm(), 1e-6 * cost);
  }
}

TEST_P(PoseFitWith, VisionErrorRisesAndConstraintErrorFallsWithTheWeight) {
  std::vector<double> weights{0.0};
  for (double w = 1e-3; w < 1.1e3; w *= 1.15) weights.push_back(w);
  const PoseSweep sweep = Scene(GetParam()).sweep(weights);
  for (std::size_t k = 1; k < weights.size(); ++k) {
    EXPECT_GE(sweep.vision[k], sweep.vision[k - 1] * (1 - 1e-10));
    EXPECT_LE(sweep.constraint[k], sweep.constraint[k - 1] * (1 + 1e-10));
    EXPECT_LE(sweep.constraint_slope[k], 0.0);
  }
}

TEST_P(PoseFitWith, ConstraintSlopeIsTheDerivativeByTheLogarithmOfTheWeight) {
  const Scene s(GetParam(), 0.2);
  for (double weight : {0.1, 1.0, 10.0}) {
    const double h = 1e-3;
    const PoseSweep at = s.sweep({weight * std::exp(-h), weight, weight * std::exp(h)});
    const double numeric = (at.constraint[2] - at.constraint[0]) / (2 * h);
    EXPECT_NEAR(at.constraint_slope[1], numeric, 0.02 * std::abs(numeric)) << weight;
  }
}

// The linear prediction and three steps of LM against refits to convergence.
TEST_P(PoseFitWith, LeaveOneOutIsThatOfFullRefits) {
  const Scene s(GetParam(), 0.5, 12);
  const std::vector<double> weights{0.0, 1.0, 30.0};
  const PoseSweep sweep = s.sweep(weights);
  for (std::size_t k = 0; k < weights.size(); ++k) {
    Pose optimum;
    std::copy_n(sweep.poses.data() + 12 * k, 12, optimum.begin());
    const double expected = refitted_score(s, weights[k], optimum);
    EXPECT_NEAR(sweep.leave_one_out[k], expected, 1e-5 * expected);
    EXPECT_NEAR(sweep.approximate_leave_one_out[k], expected, 0.05 * expected);
    EXPECT_GT(expected, sweep.vision[k]);
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, PoseFitWith, testing::ValuesIn(support::kKindsOnPoses));

}  // namespace
}  // namespace sfmcpp::pose_refinement_test

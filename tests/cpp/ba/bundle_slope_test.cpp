// The slope of the cost along a step, away from its start, against differences of the cost.
#include <cmath>
#include <ostream>

#include <gtest/gtest.h>

#include "sfmcpp/linear/step_algebra.hpp"
#include "sfmcpp/math/numeric_diff.hpp"
#include "support/all_models.hpp"
#include "support/dense_reference.hpp"

namespace sfmcpp::ba::bundle_slope_test {
namespace {

using Eigen::VectorXd;
using linear::Step;
using optim::State;
using support::LinearizedProblem;

constexpr LossKind kLosses[] = {
    LossKind::kSquared, LossKind::kHuber, LossKind::kCauchy, LossKind::kTukey};

class BundleSlopeOf : public testing::TestWithParam<CameraModelId> {
 protected:
  static support::OwnedProblem scene() {
    support::SceneOptions options = support::perturbed(GetParam());
    options.num_groups = 2;
    options.varied_sigma = true;
    support::OwnedProblem result = make_circle_scene(options);
    result.fixed_cameras[2] = result.fixed_points[5] = 1;
    return result;
  }
  void set_loss(LossKind kind) {
    work.model.set_loss({kind, 40.0});
    work.model.linearize(work.state);
  }
  Step damped_step() const {
    Step step;
    const linear::Damping damping{1e-2, linear::DampingMatrix::kDiagonal};
    EXPECT_TRUE(work.solve({linear::LinearSolverKind::kDense}, damping, step).success);
    return step;
  }
  // No normalisation: homogeneous points and matrices grow along the line.
  State candidate(const Step& step, double length) const {
    State result = work.state;
    work.model.plus(work.state, step, {length, length}, result);
    return result;
  }
  double numeric_slope(const Step& step, double length) {
    const auto cost = [&](const VectorXd& further) -> VectorXd {
      return VectorXd::Constant(1, work.model.cost(candidate(step, length + further[0])));
    };
    return numeric_jacobian(cost, VectorXd::Constant(1, 1e-4))(0, 0);
  }

  LinearizedProblem work{scene()};
};

TEST_P(BundleSlopeOf, IsTheDerivativeOfTheCostAtEveryLengthForEveryLoss) {
  for (LossKind kind : kLosses) {
    set_loss(kind);
    const Step step = damped_step();
    for (double length : {-0.5, 0.0, 0.3, 0.6, 1.5, 2.0}) {
      const double numeric = numeric_slope(step, length);
      const double slope = work.model.slope(work.state, step, candidate(step, length));
      EXPECT_NEAR(slope / numeric, 1.0, 1e-6) << enum_name(kind) << " at " << length;
    }
  }
}

TEST_P(BundleSlopeOf, AtTheStartIsThatOfTheNormalEquations) {
  for (LossKind kind : kLosses) {
    set_loss(kind);
    Step step = support::random_step(work.map, 8);
    linear::scale(work.normal(), 0.01, step);
    const linear::Slopes slopes = work.normal().slopes(step);
    const double slope = work.model.slope(work.state, step, work.state);
    EXPECT_NEAR(slope, slopes.camera + slopes.point, 1e-12 * std::abs(slopes.camera));
  }
}

TEST_P(BundleSlopeOf, LeavesTheNormalEquationsAsTheyAre) {
  set_loss(LossKind::kHuber);
  const Step step = damped_step();
  const std::vector<double> before = work.normal().camera_rhs();
  const Biquadratic algebraic = work.model.algebraic_cost(work.state, step).value();
  work.model.slope(work.state, step, candidate(step, 1.0));
  EXPECT_EQ(work.normal().camera_rhs(), before);
  EXPECT_EQ(work.model.algebraic_cost(work.state, step).value().aa, algebraic.aa);
  EXPECT_EQ(damped_step().camera, step.camera);
}

TEST_P(BundleSlopeOf, HasTheSameBitsForEveryNumberOfThreads) {
  support::SceneOptions options = support::perturbed(GetParam());
  options.num_points = 1500;  // several chunks to a camera
  const support::OwnedProblem large = make_circle_scene(options);
  LinearizedProblem one(large);
  Step step = support::random_step(one.map, 3);
  linear::scale(one.normal(), 0.01, step);
  State moved = one.state;
  one.model.plus(one.state, step, {0.5, 0.5}, moved);
  const double slope = one.model.slope(one.state, step, moved);
  for (int threads : {2, 3}) {
    LinearizedProblem more(large, false, threads);
    EXPECT_EQ(more.model.slope(more.state, step, moved), slope);
  }
}

INSTANTIATE_TEST_SUITE_P(Models,
                         BundleSlopeOf,
                         testing::ValuesIn(support::all_models()),
                         support::name_of_model);

}  // namespace
}  // namespace sfmcpp::ba::bundle_slope_test

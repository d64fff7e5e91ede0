#include "sfmcpp/ba/bundle_model.hpp"

#include <cmath>
#include <ostream>
#include <random>

#include <gtest/gtest.h>

#include "sfmcpp/linear/step_algebra.hpp"
#include "sfmcpp/math/numeric_diff.hpp"
#include "support/all_models.hpp"
#include "support/camera_dispatch.hpp"
#include "support/dense_reference.hpp"
#include "support/linearized_problem.hpp"

namespace sfmcpp::ba::bundle_model_test {
namespace {

using linear::Step;
using optim::State;
using support::LinearizedProblem;

class BundleModelOf : public testing::TestWithParam<CameraModelId> {
 protected:
  static support::OwnedProblem scene() {
    support::SceneOptions options = support::perturbed(GetParam());
    options.num_groups = 2;
    options.varied_sigma = true;
    return make_circle_scene(options);
  }
  Step random_step(double size) {
    std::mt19937 random(9);
    std::normal_distribution<double> normal(0.0, size);
    Step step{std::vector<double>(work.map.num_columns),
              std::vector<double>(3UL * work.graph.num_points)};
    for (double& x : step.camera) x = normal(random);
    for (double& x : step.point) x = normal(random);
    return step;
  }
  State moved(const Step& step, optim::StepLengths lengths) {
    State result = work.state;
    work.model.plus(work.state, step, lengths, result);
    return result;
  }

  LinearizedProblem work{scene()};
};

// By the definition in the header of residuals/reprojection.hpp, one observation after the other.
TEST_P(BundleModelOf, CostIsHalfTheSumOfTheSquaredResidualsOverSigma) {
  const Problem& problem = work.problem;
  double sum = 0.0;
  for (int k = 0; k < problem.num_observations(); ++k) {
    const int i = problem.camera_index[k];
    const auto image = support::project(
        GetParam(),
        &work.state.cameras[12 * i],
        &work.state.intrinsics[problem.num_intrinsics() * problem.intrinsics_index[i]],
        &work.state.points[problem.point_storage() * problem.point_index[k]]);
    const double ru = (problem.pixels[2 * k] - image.u) / problem.sigma_px[k];
    const double rv = (problem.pixels[2 * k + 1] - image.v) / problem.sigma_px[k];
    sum += ru * ru + rv * rv;
  }
  EXPECT_NEAR(work.model.cost(work.state) / (0.5 * sum), 1.0, 1e-12);
  double from_residuals = 0.0;
  for (double r : work.model.images().values(work.state)) from_residuals += r * r;
  EXPECT_NEAR(from_residuals / sum, 1.0, 1e-12);
}

// −b is the gradient: along a step δ the cost changes by −bᵀδ.
TEST_P(BundleModelOf, GradientIsTheDerivativeOfTheCostForEveryLoss) {
  const Step step = random_step(1e-5);
  for (LossKind kind :
       {LossKind::kSquared, LossKind::kHuber, LossKind::kCauchy, LossKind::kTukey}) {
    work.model.set_loss({kind, 9.0});
    work.model.linearize(work.state);
    double expected = 0.0;
    for (std::size_t k = 0; k < step.camera.size(); ++k) {
      expected -= work.normal().camera_rhs()[k] * step.camera[k];
    }
    for (std::size_t k = 0; k < step.point.size(); ++k) {
      expected -= work.normal().point_block(static_cast<int>(k / 3)).rhs[k % 3] * step.point[k];
    }
    const auto cost_along = [&](const Eigen::VectorXd& length) -> Eigen::VectorXd {
      return Eigen::VectorXd::Constant(1, work.model.cost(moved(step, {length[0], length[0]})));
    };
    const double numeric = numeric_jacobian(cost_along, Eigen::VectorXd::Constant(1, 1.0))(0, 0);
    EXPECT_NEAR(numeric / expected, 1.0, 1e-6) << enum_name(kind);
  }
}

TEST_P(BundleModelOf, AStepOfNoLengthChangesNoBit) {
  const State same = moved(random_step(0.1), {0.0, 0.0});
  EXPECT_EQ(same.cameras, work.state.cameras);
  EXPECT_EQ(same.intrinsics, work.state.intrinsics);
  EXPECT_EQ(same.points, work.state.points);
}

TEST_P(BundleModelOf, CamerasAndPointsGoTheirOwnLengths) {
  const Step step = random_step(0.01);
  const State cameras = moved(step, {1.0, 0.0}), points = moved(step, {0.0, 0.5}),
              both = moved(step, {1.0, 0.5});
  EXPECT_EQ(cameras.points, work.state.points);
  EXPECT_EQ(points.cameras, work.state.cameras);
  EXPECT_EQ(points.intrinsics, work.state.intrinsics);
  EXPECT_EQ(both.cameras, cameras.cameras);
  EXPECT_EQ(both.points, points.points);
  const int storage = work.problem.point_storage();
  for (int p = 0; p < work.graph.num_points; ++p) {
    const double* full = &step.point[3UL * p];
    const double half[3] = {0.5 * full[0], 0.5 * full[1], 0.5 * full[2]};
    double expected[kMaxPointStorage];
    plus_point(GetParam(), &work.state.points[storage * p], half, expected);
    for (int k = 0; k < storage; ++k) {
      EXPECT_DOUBLE_EQ(points.points[storage * p + k], expected[k]);
    }
  }
}

TEST_P(BundleModelOf, SharedIntrinsicsMoveOnceNotOncePerCamera) {
  const State after = moved(random_step(0.01), {1.0, 1.0});
  const Step step = random_step(0.01);
  const int count = work.problem.num_intrinsics();
  for (int camera = 0; camera < 6; ++camera) {
    for (std::size_t k = 0; k < work.free_intrinsics.size(); ++k) {
      const int column =
          work.map.columns_of(camera)[camera_tangent(GetParam()) + static_cast<int>(k)];
      const int parameter = count * work.problem.intrinsics_index[camera] + work.free_intrinsics[k];
      EXPECT_DOUBLE_EQ(after.intrinsics[parameter],
                       work.state.intrinsics[parameter] + step.camera[column]);
    }
  }
}

TEST_P(BundleModelOf, NormalisingLeavesTheCostAndWhatIsFixed) {
  support::OwnedProblem fixed = scene();
  fixed.fixed_cameras[1] = fixed.fixed_points[4] = 1;
  LinearizedProblem partly(fixed);
  const State before = moved(random_step(0.01), {1.0, 1.0});
  State after = before;
  partly.model.normalize(after);
  EXPECT_NEAR(partly.model.cost(after) / partly.model.cost(before), 1.0, 1e-12);
  EXPECT_EQ(after.intrinsics, before.intrinsics);
  const int storage = partly.problem.point_storage();
  const auto expect_unit_norm =
      [](const std::vector<double>& now, const std::vector<double>& then, int width, int kept) {
        for (int k = 0; k < static_cast<int>(now.size()) / width; ++k) {
          const Eigen::Map<const Eigen::VectorXd> a(&now[width * k], width),
              b(&then[width * k], width);
          if (k == kept || is_metric(GetParam())) {
            EXPECT_EQ(a, b);
          } else {
            EXPECT_NEAR(a.norm(), 1.0, 1e-15);
            EXPECT_GT(std::abs(b.norm() - 1.0), 1e-6) << "there was nothing to do";
          }
        }
      };
  expect_unit_norm(after.cameras, before.cameras, kCameraStorage, 1);
  expect_unit_norm(after.points, before.points, storage, 4);
}

INSTANTIATE_TEST_SUITE_P(Models,
                         BundleModelOf,
                         testing::ValuesIn(support::all_models()),
                         support::name_of_model);

}  // namespace
}  // namespace sfmcpp::ba::bundle_model_test

namespace sfmcpp::ba::bundle_slope_test {

// The slope of the cost along a step, away from its start, against differences of the cost.

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

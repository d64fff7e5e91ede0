#include "sfmcpp/ba/bundle_model.hpp"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "sfmcpp/math/numeric_diff.hpp"
#include "support/all_models.hpp"
#include "support/camera_dispatch.hpp"
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

// Points that a step makes worse are drawn back, and nothing else changes.
#include "sfmcpp/ba/held_points.hpp"

#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "support/linearized_problem.hpp"

namespace sfmcpp::ba {
namespace {

using optim::State;

class PointsOfAllModels : public testing::TestWithParam<CameraModelId> {
 protected:
  static support::OwnedProblem scene() {
    support::SceneOptions options = support::perturbed(GetParam());
    options.num_points = 600;
    return make_circle_scene(options);
  }
  // A step from the start that is as good as any.
  static State stepped(support::LinearizedProblem& work) {
    linear::Step step;
    EXPECT_TRUE(work.solve({linear::LinearSolverKind::kDense},
                           {1e-3, linear::DampingMatrix::kDiagonal},
                           step)
                    .success);
    State candidate = work.state;
    work.model.plus(work.state, step, {}, candidate);
    return candidate;
  }
  // ½ Σ‖r‖² of one point, from the residuals of all.
  static double cost_of_point(support::LinearizedProblem& work, const State& state, int point) {
    const std::vector<double> r = work.model.images().values(state);
    double sum = 0.0;
    for (int a = 0; a < work.graph.num_observations(); ++a) {
      if (work.graph.point[a] == point)
        sum += r[2L * a] * r[2L * a] + r[2L * a + 1] * r[2L * a + 1];
    }
    return 0.5 * sum;
  }
  // Sends a point far past the cameras, as a step does that ends near the plane of one.
  static void spoil(const support::LinearizedProblem& work, int point, State& candidate) {
    double* to = candidate.points.data() + work.problem.point_offset(point);
    for (int k = 0; k < 3; ++k) to[k] += k == 0 ? 30.0 : 20.0;
  }
};

TEST_P(PointsOfAllModels, NoPointIsHeldBackWhereEachGains) {
  support::LinearizedProblem work(scene());
  // From a far start to a nearer one, no chunk grows.
  const State near = stepped(work);
  EXPECT_LT(work.model.cost(near), work.model.linearize(work.state));
  EXPECT_LT(work.model.growth(), 1e-3 * work.model.cost(near));
}

TEST_P(PointsOfAllModels, OnlyAPointThatSpoilsTheStepIsHeldBackAndCostsNoMoreThanBefore) {
  support::LinearizedProblem work(scene());
  const State whole = stepped(work);
  const double unspoilt = work.model.cost(whole);
  constexpr int kSpoilt = 17;
  State candidate = whole;
  spoil(work, kSpoilt, candidate);
  ASSERT_GT(work.model.cost(candidate), unspoilt);
  ASSERT_GT(work.model.growth(), 0.0);

  EXPECT_EQ(work.model.hold_back(work.state, candidate), 1);
  EXPECT_LE(cost_of_point(work, candidate, kSpoilt), cost_of_point(work, work.state, kSpoilt));
  EXPECT_LT(work.model.cost(candidate),
            unspoilt + 1.001 * cost_of_point(work, work.state, kSpoilt));
  EXPECT_EQ(candidate.cameras, whole.cameras);
  EXPECT_EQ(candidate.intrinsics, whole.intrinsics);
  const int size = work.problem.point_storage();
  for (int k = 0; k < static_cast<int>(whole.points.size()); ++k) {
    if (k / size != kSpoilt) {
      ASSERT_EQ(candidate.points[k], whole.points[k]);
    }
  }
}

TEST_P(PointsOfAllModels, AFixedPointIsNeverDrawnAnywhere) {
  support::OwnedProblem owned = scene();
  constexpr int kSpoilt = 17;
  owned.fixed_points[kSpoilt] = 1;
  support::LinearizedProblem work(owned);
  State candidate = stepped(work);
  spoil(work, kSpoilt, candidate);
  const State before = candidate;
  work.model.cost(candidate);
  work.model.hold_back(work.state, candidate);
  const int size = work.problem.point_storage();
  for (int k = size * kSpoilt; k < size * (kSpoilt + 1); ++k)
    EXPECT_EQ(candidate.points[k], before.points[k]);
}

TEST_P(PointsOfAllModels, TheGrowthIsThatOfPartsThatGrewAlone) {
  support::LinearizedProblem work(scene());
  State candidate = work.state;
  EXPECT_EQ(work.model.cost(candidate), work.model.linearize(work.state));
  EXPECT_EQ(work.model.growth(), 0.0);
  spoil(work, 17, candidate);
  const double grown = cost_of_point(work, candidate, 17) - cost_of_point(work, work.state, 17);
  work.model.cost(candidate);
  EXPECT_NEAR(work.model.growth(), grown, 1e-9 * grown);
}

INSTANTIATE_TEST_SUITE_P(All,
                         PointsOfAllModels,
                         testing::Values(CameraModelId::kCalibrated,
                                         CameraModelId::kPerspective,
                                         CameraModelId::kBal,
                                         CameraModelId::kProjective));

// One point starts so near the plane of a camera that the linear model is no guide.
class OneSickPoint : public testing::Test {
 protected:
  static support::OwnedProblem scene() {
    support::SceneOptions options = support::perturbed(CameraModelId::kBal);
    options.num_cameras = 12;
    options.num_points = 1300;
    options.window = 6;
    support::OwnedProblem owned = make_circle_scene(options);
    const Problem view = owned.view();
    const int point = view.point_index[0], camera = view.camera_index[0];
    // In front of the camera by a hundredth of the way, and aside.
    const double* pose = owned.cameras.data() + view.camera_offset(camera);
    double* x = owned.points.data() + view.point_offset(point);
    double centre[3] = {};
    for (int c = 0; c < 3; ++c) {
      for (int r = 0; r < 3; ++r) centre[c] -= pose[4 * r + c] * pose[4 * r + 3];
    }
    for (int c = 0; c < 3; ++c) x[c] = centre[c] + kShare * (x[c] - centre[c]) + 0.02 * (c + 1);
    return owned;
  }
  static SolveSummary solved(int threads, State& state) {
    const support::OwnedProblem owned = scene();
    SolveOptions options;
    options.num_threads = threads;
    state = state_of(owned.view());
    return solve(owned.view(), options, {}, state);
  }
  static constexpr double kShare = 0.01;
};

TEST_F(OneSickPoint, IsHeldBackToTheSameBitsForAnyNumberOfThreads) {
  State one, other;
  const auto summary = solved(1, one);
  long held = 0;
  for (const optim::Iteration& iteration : summary.minimizer.iterations)
    held += iteration.held_points;
  EXPECT_GT(held, 0);
  for (int threads : {2, 3, 5}) {
    solved(threads, other);
    EXPECT_EQ(one.cameras, other.cameras) << threads << " threads";
    EXPECT_EQ(one.points, other.points) << threads << " threads";
  }
}

}  // namespace
}  // namespace sfmcpp::ba

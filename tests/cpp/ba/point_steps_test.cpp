// Points that a step makes worse are drawn back, those that it takes beyond its linear model are
// fitted to the cameras, and nothing else changes.
#include <gtest/gtest.h>

#include "sfmcpp/ba/held_points.hpp"
#include "sfmcpp/ba/point_refits.hpp"
#include "sfmcpp/ba/solve.hpp"
#include "sfmcpp/cameras/matrix34.hpp"
#include "support/linearized_problem.hpp"

namespace sfmcpp::ba::point_steps_test {
namespace {

using optim::Iteration;
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
    return stepped(work, step);
  }
  static State stepped(support::LinearizedProblem& work, linear::Step& step) {
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
  // Past infinity: to the other side of the first camera that sees it, far away.
  static void throw_behind(const support::LinearizedProblem& work, int point, State& state) {
    const Eigen::Vector3d centre = centre_of_first_camera(work, point, state);
    double* place = state.points.data() + work.problem.point_offset(point);
    for (int k = 0; k < 3; ++k) place[k] = centre[k] - 100.0 * (place[k] - centre[k]);
  }
  // Whether a point is on the side of that camera on which it is in the other state.
  static bool is_on_side_of(const support::LinearizedProblem& work,
                            int point,
                            const State& state,
                            const State& other) {
    const Eigen::Vector3d centre = centre_of_first_camera(work, point, state);
    const std::size_t at = work.problem.point_offset(point);
    const Eigen::Map<const Eigen::Vector3d> here(state.points.data() + at);
    const Eigen::Map<const Eigen::Vector3d> there(other.points.data() + at);
    return (here - centre).dot(there - centre) > 0.0;
  }

 private:
  static Eigen::Vector3d centre_of_first_camera(const support::LinearizedProblem& work,
                                                int point,
                                                const State& state) {
    const int camera = work.graph.camera[work.graph.of_point[work.graph.point_begin[point]]];
    const PoseMatrixView pose(state.cameras.data() + work.problem.camera_offset(camera));
    if (is_metric(work.problem.camera_model)) return pose.col(3);
    return -pose.leftCols<3>().inverse() * pose.col(3);
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

// A share of nothing: all points that have moved.
TEST_P(PointsOfAllModels, RefittedPointsAreWhereFixedCamerasWantThem) {
  support::LinearizedProblem work(scene());
  linear::Step step;
  State candidate = stepped(work, step);
  const State before = candidate;
  EXPECT_EQ(work.model.refit(work.state, step, 0.0, candidate), work.problem.num_points());
  EXPECT_EQ(candidate.cameras, before.cameras);
  EXPECT_EQ(candidate.intrinsics, before.intrinsics);
  for (int p = 0; p < work.problem.num_points(); p += 7)
    EXPECT_LE(cost_of_point(work, candidate, p), cost_of_point(work, before, p));

  support::OwnedProblem fixed = work.owned;
  fixed.cameras = before.cameras;
  fixed.intrinsics = before.intrinsics;
  fixed.points = before.points;
  fixed.fixed_cameras.assign(fixed.fixed_cameras.size(), 1);
  fixed.fixed_intrinsics.assign(fixed.intrinsics.size(), 1);
  State optimum = state_of(fixed.view());
  const double least = solve(fixed.view(), {}, {}, optimum).minimizer.final_cost;
  const double start = work.model.cost(before), end = work.model.cost(candidate);
  EXPECT_GT(start, 1.02 * least) << "there is nothing to gain";
  EXPECT_LT(end, least + 0.01 * (start - least));
}

TEST_P(PointsOfAllModels, OnlyAPointThatLeavesTheModelIsRefitted) {
  support::OwnedProblem owned = scene();
  constexpr int kFar = 17, kFixed = 18;
  owned.fixed_points[kFixed] = 1;
  support::LinearizedProblem work(owned);
  linear::Step step;
  stepped(work, step);
  for (double& number : step.camera) number = 0.0;
  for (std::size_t k = 0; k < step.point.size(); ++k)
    step.point[k] = k / 3 == kFar || k / 3 == kFixed ? 0.3 : 1e-9;
  State candidate = work.state;
  work.model.plus(work.state, step, {}, candidate);
  const State before = candidate;
  const double cost = work.model.cost(candidate);
  EXPECT_EQ(work.model.refit(work.state, step, cost, candidate), 1);
  EXPECT_LT(cost_of_point(work, candidate, kFar), cost_of_point(work, before, kFar));
  const int size = work.problem.point_storage();
  for (int k = 0; k < static_cast<int>(before.points.size()); ++k) {
    if (k / size != kFar) {
      ASSERT_EQ(candidate.points[k], before.points[k]);
    }
  }
}

// From behind the cameras no fit brings a point back: its cost falls towards infinity.
TEST_P(PointsOfAllModels, APointThatAStepThrowsBehindTheCamerasIsFittedFromWhereItWas) {
  support::LinearizedProblem work(scene());
  linear::Step step;
  State candidate = stepped(work, step);
  const State before = candidate;
  constexpr int kThrown = 17;
  throw_behind(work, kThrown, candidate);
  for (int k = 0; k < 3; ++k) step.point[3 * kThrown + k] = 10.0;
  work.model.refit(work.state, step, work.model.cost(before), candidate);
  EXPECT_LE(cost_of_point(work, candidate, kThrown),
            1.01 * cost_of_point(work, work.state, kThrown));
  EXPECT_TRUE(is_on_side_of(work, kThrown, candidate, before));
}

TEST_P(PointsOfAllModels, APointThatHasBeenBehindTheCamerasIsTriangulated) {
  if (!is_metric(GetParam())) GTEST_SKIP() << "rays of a projective world have no front";
  support::OwnedProblem owned = scene();
  constexpr int kLost = 17;
  support::LinearizedProblem right(owned);
  State lost = right.state;
  throw_behind(right, kLost, lost);
  owned.points = lost.points;
  support::LinearizedProblem work(owned);
  linear::Step step;
  State candidate = stepped(work, step);
  for (int k = 0; k < 3; ++k) step.point[3 * kLost + k] = 10.0;
  work.model.refit(work.state, step, right.model.cost(right.state), candidate);
  EXPECT_LT(cost_of_point(work, candidate, kLost), 0.1 * cost_of_point(work, work.state, kLost));
  EXPECT_TRUE(is_on_side_of(work, kLost, candidate, right.state));
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
  static SolveSummary solved(optim::PointSteps steps, int threads, State& state) {
    const support::OwnedProblem owned = scene();
    SolveOptions options;
    options.minimizer.point_steps = steps;
    options.minimizer.intrinsic_steps = optim::IntrinsicSteps::kWhole;
    options.num_threads = threads;
    state = state_of(owned.view());
    return solve(owned.view(), options, {}, state);
  }
  static constexpr double kShare = 0.01;
};

TEST_F(OneSickPoint, IsMendedToTheSameBitsForAnyNumberOfThreads) {
  for (const auto& [steps, mended] :
       {std::pair{optim::PointSteps::kHeldBack, &Iteration::held_points},
        std::pair{optim::PointSteps::kRefitted, &Iteration::refitted_points}}) {
    State one, other;
    const auto summary = solved(steps, 1, one);
    long count = 0;
    for (const Iteration& iteration : summary.minimizer.iterations) count += iteration.*mended;
    EXPECT_GT(count, 0);
    for (int threads : {2, 3, 5}) {
      solved(steps, threads, other);
      EXPECT_EQ(one.cameras, other.cameras) << threads << " threads";
      EXPECT_EQ(one.points, other.points) << threads << " threads";
    }
  }
}

// From a start whose points are as far off as their cameras.
TEST_F(OneSickPoint, TakesFewerStepsWherePointsAreRefitted) {
  std::size_t steps[2];
  for (const auto kind : {optim::PointSteps::kHeldBack, optim::PointSteps::kRefitted}) {
    State state;
    const auto summary = solved(kind, 2, state).minimizer;
    EXPECT_EQ(summary.termination, optim::Termination::kConverged);
    steps[kind == optim::PointSteps::kRefitted] = summary.iterations.size();
  }
  EXPECT_LT(steps[1], steps[0]);
}

}  // namespace
}  // namespace sfmcpp::ba::point_steps_test

#include "sfmcpp/ba/late_intrinsics.hpp"

#include <vector>

#include <gtest/gtest.h>

#include "support/linearized_problem.hpp"

namespace sfmcpp::ba::late_intrinsics_test {
namespace {

using optim::State;
using support::LinearizedProblem;

support::OwnedProblem scene(CameraModelId model, int groups = 0) {
  support::SceneOptions options = support::perturbed(model);
  options.num_cameras = 7;
  options.num_groups = groups;
  return make_circle_scene(options);
}

// Whether focal lengths count as far after the first `count` have been multiplied by `factor`.
bool far_after(const LinearizedProblem& work, int count, double factor) {
  State candidate = work.state;
  for (int row = 0; row < count; ++row)
    candidate.intrinsics[static_cast<std::size_t>(work.problem.num_intrinsics()) * row] *= factor;
  return LateIntrinsics(work.problem, work.map, work.free_intrinsics)
      .have_moved_far(work.state, candidate);
}

TEST(LateIntrinsics, CompareTheMedianOfTheFocalLengths) {
  const LinearizedProblem work(scene(CameraModelId::kBal));
  EXPECT_FALSE(far_after(work, 0, 1.5));
  EXPECT_FALSE(far_after(work, 3, 1.5));
  EXPECT_TRUE(far_after(work, 4, 1.5));
  EXPECT_FALSE(far_after(work, 7, 1.019));
  EXPECT_TRUE(far_after(work, 7, 1.021));
  EXPECT_TRUE(far_after(work, 7, 1 / 1.021));
  EXPECT_TRUE(far_after(work, 7, -1.0));
}

TEST(LateIntrinsics, CountSharedRowsOnce) {
  const LinearizedProblem work(scene(CameraModelId::kBal, 3));
  EXPECT_FALSE(far_after(work, 1, 1.5));
  EXPECT_TRUE(far_after(work, 2, 1.5));
  support::OwnedProblem uneven = scene(CameraModelId::kBal, 3);
  uneven.intrinsics_index = {0, 0, 0, 0, 0, 1, 2};
  EXPECT_FALSE(far_after(LinearizedProblem(uneven), 1, 1.5));
}

TEST(LateIntrinsics, DoNotMoveWhereTheyAreFixed) {
  const LinearizedProblem work(scene(CameraModelId::kCalibrated));
  EXPECT_FALSE(far_after(work, 7, 1.5));
}

linear::Step step_of(const LinearizedProblem& work) {
  linear::Step step;
  const linear::Damping damping{1e-4, linear::DampingMatrix::kDiagonal};
  EXPECT_TRUE(work.solve({.kind = linear::LinearSolverKind::kDense}, damping, step).success);
  return step;
}

TEST(LateIntrinsics, LeaveTheStepOfFixedOnesToTheOthersWhereTheyAreHeld) {
  LinearizedProblem held(scene(CameraModelId::kBal));
  held.model.hold_intrinsics(true);
  support::OwnedProblem without = scene(CameraModelId::kBal);
  without.fixed_intrinsics.assign(without.intrinsics.size(), 1);
  const LinearizedProblem fixed(without);
  const linear::Step step = step_of(held), expected = step_of(fixed);
  std::vector<double> of_poses;
  for (std::size_t k = 0; k < step.camera.size(); ++k) {
    if (held.map.is_intrinsic[k] == 0) of_poses.push_back(step.camera[k]);
  }
  ASSERT_EQ(of_poses.size(), expected.camera.size());
  for (std::size_t k = 0; k < of_poses.size(); ++k)
    EXPECT_NEAR(of_poses[k], expected.camera[k], 1e-4) << k;
  for (std::size_t k = 0; k < step.point.size(); ++k)
    EXPECT_NEAR(step.point[k], expected.point[k], 1e-4) << k;
}

TEST(LateIntrinsics, MoveAsBeforeWhenTheyAreFreedAgain) {
  LinearizedProblem work(scene(CameraModelId::kBal));
  const linear::Step before = step_of(work);
  work.model.hold_intrinsics(true);
  EXPECT_NE(step_of(work).camera, before.camera);
  work.model.hold_intrinsics(false);
  EXPECT_EQ(step_of(work).camera, before.camera);
}

}  // namespace
}  // namespace sfmcpp::ba::late_intrinsics_test

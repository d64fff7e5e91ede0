#include "sfmcpp/ba/world_frame.hpp"

#include <algorithm>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "support/linearized_problem.hpp"

namespace sfmcpp::ba::world_frame_test {
namespace {

using Eigen::Vector4d;
using optim::State;
using support::LinearizedProblem;

class WorldFrameOf : public testing::Test {
 protected:
  static support::OwnedProblem scene() {
    support::OwnedProblem owned = make_circle_scene(support::perturbed(CameraModelId::kProjective));
    // Coordinates of any norm and sign.
    for (std::size_t k = 0; k < owned.cameras.size(); ++k)
      owned.cameras[k] *= 2.0 + static_cast<double>(k / 12);
    for (std::size_t k = 0; k < owned.points.size(); ++k)
      owned.points[k] *= k / 4 % 2 == 0 ? -0.5 : 3.0;
    return owned;
  }
  static double norm(const std::vector<double>& values, std::size_t first, int size) {
    return Eigen::Map<const Eigen::VectorXd>(&values[first], size).norm();
  }
  std::vector<double> distances(const State& state) const {
    std::vector<double> result;
    for (std::size_t k = 0; k < state.points.size(); k += 4)
      result.push_back(Vector4d(&state.points[k]).hnormalized().norm());
    std::sort(result.begin(), result.end());
    return result;
  }

  LinearizedProblem work{scene()};
  State inside = [this] {
    State state = work.state;
    WorldFrame(work.state).enter(state);
    return state;
  }();
};

TEST_F(WorldFrameOf, LeavesEveryImageUnchanged) {
  const std::vector<double> before = work.model.images().values(work.state);
  const std::vector<double> after = work.model.images().values(inside);
  for (std::size_t k = 0; k < before.size(); ++k) EXPECT_NEAR(after[k], before[k], 1e-9);
}

TEST_F(WorldFrameOf, KeepsTheNormOfEveryCameraAndPoint) {
  for (std::size_t k = 0; k < inside.cameras.size(); k += 12)
    EXPECT_NEAR(norm(inside.cameras, k, 12) / norm(work.state.cameras, k, 12), 1.0, 1e-14);
  for (std::size_t k = 0; k < inside.points.size(); k += 4)
    EXPECT_NEAR(norm(inside.points, k, 4) / norm(work.state.points, k, 4), 1.0, 1e-14);
}

TEST_F(WorldFrameOf, PutsHalfOfThePointsWithinATenthOfTheOrigin) {
  const std::vector<double> radii = distances(inside);
  EXPECT_NEAR((radii[19] + radii[20]) / 2.0, 0.1, 1e-12);
  EXPECT_GT(distances(work.state)[20], 1.0) << "there was nothing to do";
}

TEST_F(WorldFrameOf, LeavingGivesBackTheStartSignsIncluded) {
  State back = inside;
  WorldFrame(work.state).leave(back);
  for (std::size_t k = 0; k < back.cameras.size(); ++k)
    EXPECT_NEAR(
        back.cameras[k], work.state.cameras[k], 1e-13 * norm(back.cameras, k / 12 * 12, 12));
  for (std::size_t k = 0; k < back.points.size(); ++k)
    EXPECT_NEAR(back.points[k], work.state.points[k], 1e-13 * norm(back.points, k / 4 * 4, 4));
}

TEST_F(WorldFrameOf, PointsAtInfinityStayThereAndDoNotCount) {
  State far = work.state;
  far.points.insert(far.points.end(), {0.6, -0.8, 0.0, 0.0});
  WorldFrame(far).enter(far);
  EXPECT_EQ(far.points.back(), 0.0);
  EXPECT_NEAR(far.points[far.points.size() - 4], 0.6, 1e-15);
  far.points.erase(far.points.end() - 4, far.points.end());
  EXPECT_EQ(far.points, inside.points);
}

TEST_F(WorldFrameOf, OfPointsThatAllCoincideIsThatOfTheStart) {
  State same = work.state;
  for (std::size_t k = 0; k < same.points.size(); ++k) same.points[k] = same.points[k % 4];
  const State before = same;
  WorldFrame(same).enter(same);
  for (std::size_t k = 0; k < same.points.size(); ++k)
    EXPECT_NEAR(same.points[k], before.points[k], 1e-15);
  for (std::size_t k = 0; k < same.cameras.size(); ++k)
    EXPECT_NEAR(same.cameras[k], before.cameras[k], 1e-14 * std::abs(before.cameras[k]));
}

}  // namespace
}  // namespace sfmcpp::ba::world_frame_test

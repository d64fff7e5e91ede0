#include <gtest/gtest.h>

#include "sfmcpp/ba/check.hpp"
#include "sfmcpp/linear/observation_graph.hpp"
#include "support/small_scenes.hpp"

namespace sfmcpp::ba::warnings_test {
namespace {

using support::OwnedProblem;

using Pairs = std::vector<std::pair<int, int>>;
using Warnings = std::vector<std::string>;

Warnings warnings_of(int num_cameras, int num_points, const Pairs& camera_and_point) {
  std::vector<int> camera, point;
  for (const auto& [i, p] : camera_and_point) {
    camera.push_back(i);
    point.push_back(p);
  }
  return warnings_about(linear::make_observation_graph(num_cameras, num_points, camera, point));
}

TEST(Warnings, AWellConnectedProblemHasNone) {
  EXPECT_EQ(warnings_of(2, 2, {{0, 0}, {1, 0}, {0, 1}, {1, 1}}), Warnings{});
}

TEST(Warnings, UnobservedCamerasAndPointsAreNamed) {
  EXPECT_EQ(warnings_of(4, 3, {{0, 0}, {2, 0}, {0, 1}, {2, 1}}),
            (Warnings{"cameras 1, 3: no observations, left as given",
                      "point 2: no observations, left as given"}));
}

TEST(Warnings, PointsSeenOnceAreNamed) {
  const Warnings warnings = warnings_of(2, 2, {{0, 0}, {1, 0}, {1, 1}});
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_EQ(warnings[0].substr(0, 33), "point 1: seen by one camera only,");
}

TEST(Warnings, LongListsAreCutAfterFiveAndCounted) {
  const Warnings warnings = warnings_of(9, 1, {{0, 0}, {1, 0}});
  EXPECT_EQ(warnings, Warnings{"7 cameras (2, 3, 4, 5, 6, …): no observations, left as given"});
}

TEST(Warnings, PartsThatShareNoPointAreCountedUnobservedCamerasAside) {
  const Pairs three_parts{{0, 0}, {1, 0}, {2, 1}, {3, 1}, {4, 2}, {5, 2}};
  const Warnings warnings = warnings_of(7, 3, three_parts);
  ASSERT_EQ(warnings.size(), 2u);
  EXPECT_EQ(warnings[1],
            "the cameras fall into 3 parts that share no point: their relative position, rotation "
            "and scale "
            "are arbitrary");
}

TEST(Warnings, AChainOfCommonPointsIsOnePart) {
  EXPECT_EQ(warnings_of(4, 3, {{0, 0}, {1, 0}, {1, 1}, {2, 1}, {2, 2}, {3, 2}}), Warnings{});
}

// Camera 1 has so many.
OwnedProblem scene_with_a_camera_of(int observations) {
  const OwnedProblem scene = support::make_circle_scene({});
  OwnedProblem kept = scene;
  kept.camera_index.clear();
  kept.point_index.clear();
  kept.pixels.clear();
  kept.sigma_px.clear();
  for (std::size_t k = 0; k < scene.camera_index.size(); ++k) {
    if (scene.camera_index[k] != 1 || observations-- > 0) {
      kept.camera_index.push_back(scene.camera_index[k]);
      kept.point_index.push_back(scene.point_index[k]);
      kept.pixels.insert(kept.pixels.end(), {scene.pixels[2 * k], scene.pixels[2 * k + 1]});
    }
  }
  return kept;
}

Warnings warnings_about_cameras_of(const OwnedProblem& scene, bool constrained = false) {
  const Problem p = scene.view();
  const auto graph = linear::make_observation_graph(
      p.num_cameras(), p.num_points(), p.camera_index, p.point_index);
  return warnings_about_cameras(p, graph, constrained);
}

TEST(Warnings, CamerasWithFewerObservationsThanAPoseNeedsAreNamed) {
  const Warnings named{"camera 1: fewer than 3 observations, the pose is held by damping alone"};
  OwnedProblem scene = scene_with_a_camera_of(2);
  EXPECT_EQ(warnings_about_cameras_of(scene), named);
  EXPECT_EQ(warnings_about_cameras_of(scene, true), Warnings{});
  scene.fixed_cameras[1] = 1;
  EXPECT_EQ(warnings_about_cameras_of(scene), Warnings{});
  EXPECT_EQ(warnings_about_cameras_of(scene_with_a_camera_of(3)), Warnings{});
}

TEST(Warnings, FocalLengthsThatAreNotPositiveAreNamedWhereACameraHasThem) {
  OwnedProblem scene = support::make_circle_scene({});
  scene.intrinsics.insert(scene.intrinsics.end(), {0.0, 1.0, 0.0, 0.0, 0.0});  // of no camera
  EXPECT_EQ(warnings_about_cameras_of(scene), Warnings{});
  scene.intrinsics[5] = 0.0;
  scene.intrinsics[10] *= -1.0;
  EXPECT_EQ(warnings_about_cameras_of(scene),
            Warnings{"intrinsics rows 1, 2: the focal length f is not positive: a lens has f > 0, "
                     "images upside down have negative y"});
}

TEST(Warnings, AnAspectThatIsAFocalLengthIsNamed) {
  OwnedProblem scene = support::make_circle_scene({});
  scene.intrinsics[1] = scene.intrinsics[0];
  EXPECT_EQ(warnings_about_cameras_of(scene),
            Warnings{"intrinsics row 0: the aspect, fy / fx, is more than 20: is it fy?"});
}

}  // namespace
}  // namespace sfmcpp::ba::warnings_test

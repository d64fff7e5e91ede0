#include <gtest/gtest.h>

#include "sfmcpp/ba/check.hpp"
#include "sfmcpp/linear/observation_graph.hpp"

namespace sfmcpp::ba::warnings_test {
namespace {

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

}  // namespace
}  // namespace sfmcpp::ba::warnings_test

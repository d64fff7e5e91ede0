#include "sfmcpp/ba/mask.hpp"

#include <algorithm>
#include <set>

#include <gtest/gtest.h>

#include "support/all_models.hpp"
#include "support/linearized_problem.hpp"

namespace sfmcpp::ba::mask_test {
namespace {

using linear::kNoColumn;
using linear::ParameterMap;
using support::OwnedProblem;

OwnedProblem scene_of(CameraModelId model, int groups = 0) {
  support::SceneOptions options;
  options.camera_model = model;
  options.num_groups = groups;
  return make_circle_scene(options);
}

ParameterMap map_of(const OwnedProblem& scene, bool fix_gauge = false) {
  const Problem p = scene.view();
  const auto graph = linear::make_observation_graph(
      p.num_cameras(), p.num_points(), p.camera_index, p.point_index);
  return make_parameter_map(
      p,
      graph,
      free_intrinsics(p, graph),
      fix_gauge ? choose_gauge(p, graph, state_of(p)) : std::vector<PoseParameter>{});
}

int distinct_columns(const ParameterMap& map) {
  std::set<int> columns(map.column.begin(), map.column.end());
  columns.erase(kNoColumn);
  return static_cast<int>(columns.size());
}

TEST(Mask, EveryCameraHasTheColumnsOfItsTangentAndEveryFreeIntrinsicOne) {
  EXPECT_EQ(map_of(scene_of(CameraModelId::kCalibrated)).num_columns, 6 * 6);
  EXPECT_EQ(map_of(scene_of(CameraModelId::kPerspective)).num_columns, 6 * 7);
  EXPECT_EQ(map_of(scene_of(CameraModelId::kBal)).num_columns, 6 * 9);
  EXPECT_EQ(map_of(scene_of(CameraModelId::kProjective)).num_columns, 6 * 12);
}

TEST(Mask, SharedIntrinsicsHaveOneSetOfColumnsForEachRow) {
  const ParameterMap map = map_of(scene_of(CameraModelId::kBal, 2));
  EXPECT_EQ(map.num_columns, 6 * 6 + 2 * 3);
  EXPECT_EQ(distinct_columns(map), map.num_columns);
  for (int i = 0; i < 6; ++i) {
    for (int k = 6; k < 9; ++k) {
      EXPECT_EQ(map.columns_of(i)[k], map.columns_of(i % 2)[k])
          << "cameras of a group share columns";
      EXPECT_NE(map.columns_of(i)[k], map.columns_of((i + 1) % 2)[k]);
    }
  }
}

TEST(Mask, FixedGaugeTakesExactlySevenColumns) {
  for (CameraModelId model : support::metric_models()) {
    for (int groups : {0, 1, 2}) {
      const OwnedProblem scene = scene_of(model, groups);
      EXPECT_EQ(map_of(scene, true).num_columns, map_of(scene).num_columns - 7);
      EXPECT_EQ(distinct_columns(map_of(scene, true)), map_of(scene, true).num_columns);
    }
  }
}

TEST(Mask, FixedGaugeHoldsTheFirstPoseAndTheLongestCoordinateOfABaseline) {
  OwnedProblem scene = scene_of(CameraModelId::kCalibrated);
  const ParameterMap map = map_of(scene, true);
  for (int k = 0; k < 6; ++k) EXPECT_EQ(map.columns_of(0)[k], kNoColumn);
  // Camera 3 is opposite camera 0 on the circle: the baseline is along x.
  EXPECT_EQ(map.columns_of(3)[3], kNoColumn);
  EXPECT_EQ(std::count(map.column.begin(), map.column.end(), kNoColumn), 7);
}

TEST(Mask, FixedGaugeAddsToAFixedCameraOnlyTheScale) {
  OwnedProblem scene = scene_of(CameraModelId::kCalibrated);
  scene.fixed_cameras[4] = 1;
  EXPECT_EQ(map_of(scene).num_columns, 5 * 6);
  EXPECT_EQ(map_of(scene, true).num_columns, 5 * 6 - 1);
}

TEST(Mask, FixedGaugeTakesNothingWhereTwoCamerasOrThreePointsAreFixed) {
  OwnedProblem cameras = scene_of(CameraModelId::kBal), points = cameras;
  cameras.fixed_cameras[1] = cameras.fixed_cameras[2] = 1;
  points.fixed_points[1] = points.fixed_points[2] = points.fixed_points[5] = 1;
  EXPECT_EQ(map_of(cameras, true).num_columns, map_of(cameras).num_columns);
  EXPECT_EQ(map_of(points, true).num_columns, map_of(points).num_columns);
}

TEST(Mask, ASingleFixedIntrinsicLosesItsColumnInItsRowOnly) {
  OwnedProblem scene = scene_of(CameraModelId::kBal);
  scene.fixed_intrinsics[3 * 2 + 1] = 1;  // k1 of camera 2
  const ParameterMap map = map_of(scene);
  EXPECT_EQ(map.num_columns, 6 * 9 - 1);
  EXPECT_EQ(map.columns_of(2)[7], kNoColumn);
  EXPECT_NE(map.columns_of(1)[7], kNoColumn);
}

TEST(Mask, ThingsWithoutObservationsHaveNoColumn) {
  OwnedProblem scene = scene_of(CameraModelId::kBal);
  for (std::size_t k = 0; k < scene.camera_index.size(); ++k) {
    if (scene.camera_index[k] == 5) scene.camera_index[k] = 4;
    if (scene.point_index[k] == 8) scene.point_index[k] = 9;
  }
  const ParameterMap map = map_of(scene);
  EXPECT_EQ(map.num_columns, 5 * 9);
  EXPECT_EQ(map.free_point[8], 0);
  EXPECT_EQ(std::count(map.free_point.begin(), map.free_point.end(), 1), 39);
}

TEST(FreeIntrinsics, AreThoseFreeInSomeRowThatAnObservedCameraUses) {
  OwnedProblem scene = scene_of(CameraModelId::kPerspective);
  scene.fixed_intrinsics[12 * 1 + 5] = 0;  // k1 of camera 1
  scene.fixed_intrinsics[12 * 5 + 6] = 0;  // k2 of camera 5, which will see nothing
  for (int& camera : scene.camera_index) camera = std::min(camera, 4);
  const Problem p = scene.view();
  const auto graph = linear::make_observation_graph(
      p.num_cameras(), p.num_points(), p.camera_index, p.point_index);
  EXPECT_EQ(free_intrinsics(p, graph), (std::vector<int>{0, 5}));
}

TEST(FreeIntrinsics, CalibrationsAndFramesOfImagesAreNeverFreeWhateverTheMaskSays) {
  for (const auto& [model, columns] :
       {std::pair{CameraModelId::kCalibrated, 36}, std::pair{CameraModelId::kProjective, 72}}) {
    OwnedProblem scene = scene_of(model);
    std::fill(scene.fixed_intrinsics.begin(), scene.fixed_intrinsics.end(), 0);
    EXPECT_EQ(map_of(scene).num_columns, columns);
  }
}

}  // namespace
}  // namespace sfmcpp::ba::mask_test

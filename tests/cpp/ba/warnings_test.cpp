#include <array>
#include <cmath>
#include <memory>

#include <gtest/gtest.h>

#include "sfmcpp/ba/check.hpp"
#include "sfmcpp/ba/check_jacobians.hpp"
#include "sfmcpp/ba/solve.hpp"
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

// What is said of two parts of two cameras each, which see three points and four, of what is fixed.
std::string relation_of_parts(const std::vector<std::uint8_t>& cameras,
                              const std::vector<std::uint8_t>& points,
                              Anchors anchors = {}) {
  const std::vector<int> camera{0, 0, 0, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};
  const std::vector<int> point{0, 1, 2, 0, 1, 2, 3, 4, 5, 6, 3, 4, 5, 6};
  anchors.fixed_cameras = cameras;
  anchors.fixed_points = points;
  const Warnings warnings =
      warnings_about(linear::make_observation_graph(4, 7, camera, point), {}, anchors);
  return warnings.size() == 1 ? warnings[0].substr(warnings[0].find(": ") + 2) : "";
}

TEST(Warnings, PartsThatFixedCamerasOrPointsHoldAreNotArbitrary) {
  const std::string arbitrary = "their relative position, rotation and scale are arbitrary";
  const std::string held = "nothing but fixed cameras and fixed points relates them";
  const auto some = [](int count) {
    return "fixed cameras and fixed points hold " + std::to_string(count) +
           " of them; the position, rotation or scale of the others is arbitrary";
  };
  EXPECT_EQ(relation_of_parts({}, {}), arbitrary);
  EXPECT_EQ(relation_of_parts({1, 1, 0, 0}, {}), arbitrary);  // the gauge alone
  EXPECT_EQ(relation_of_parts({}, {1, 1, 1, 0, 0, 0, 0}), arbitrary);
  EXPECT_EQ(relation_of_parts({1, 1, 1, 1}, {}), held);
  EXPECT_EQ(relation_of_parts({}, {1, 1, 1, 1, 1, 1, 0}), held);
  EXPECT_EQ(relation_of_parts({1, 0, 0, 0}, {0, 1, 0, 1, 1, 1, 0}), held);
  EXPECT_EQ(relation_of_parts({1, 0, 1, 0}, {}), some(0));  // scales
  EXPECT_EQ(relation_of_parts({1, 1, 0, 0}, {0, 0, 0, 1, 1, 0, 0}), some(1));
}

TEST(Warnings, PartsOfAProjectiveWorldNeedMoreThatIsFixed) {
  const Anchors projective{.is_metric = false};
  EXPECT_EQ(relation_of_parts({1, 1, 1, 1}, {}, projective).substr(0, 11), "nothing but");
  EXPECT_EQ(relation_of_parts({}, {1, 1, 1, 1, 1, 1, 1}, projective).substr(0, 38),
            "fixed cameras and fixed points hold 0 ");
}

TEST(Warnings, ConstraintsMayRelateParts) {
  const Anchors constrained{.constrained = true};
  EXPECT_EQ(relation_of_parts({}, {}, constrained), "nothing but constraints relates them");
  EXPECT_EQ(relation_of_parts({1, 0, 1, 0}, {}, constrained),
            "nothing but constraints, fixed cameras and fixed points relates them");
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

// Of a solve that fails: what it says.
Warnings warnings_of_failure(const Problem& problem) {
  optim::State state = state_of(problem);
  const SolveSummary summary = solve(problem, {}, {}, state);
  EXPECT_EQ(summary.minimizer.termination, optim::Termination::kNumericalFailure);
  return summary.warnings;
}

TEST(Warnings, AResidualThatIsNotFiniteAtTheStartIsNamed) {
  OwnedProblem scene = support::make_circle_scene({});
  scene.pixels[2 * 70] = 1e300;
  scene.pixels[2 * 9] = 1e300;
  const std::string point = std::to_string(scene.point_index[9]);
  const std::string camera = std::to_string(scene.camera_index[9]);
  EXPECT_EQ(warnings_of_failure(scene.view()),
            Warnings{"point " + point + ": its squared residual is not a finite number in camera " +
                     camera + ", observation 9 (2 such observations)"});
}

// A pinhole with the intrinsics of calibrated cameras that writes no derivatives.
class Careless final : public CameraFunction {
 public:
  const std::string& name() const override { return name_; }
  std::span<const std::string_view> intrinsic_names() const override { return names_; }
  void image(int count,
             const double* points,
             const double* intrinsics,
             double* pixels,
             const Jacobians*) const override {
    for (long k = 0; k < count; ++k) {
      const double *x = points + 3 * k, *own = intrinsics + 5 * k;
      pixels[2 * k] = own[0] * x[0] / x[2] + own[2];
      pixels[2 * k + 1] = own[0] * own[1] * x[1] / x[2] + own[3];
    }
  }

 private:
  std::string name_ = "careless";
  std::array<std::string_view, 5> names_{"f", "aspect", "cx", "cy", "skew"};
};

TEST(Warnings, DerivativesThatACameraFunctionDoesNotWriteAreNoConvergence) {
  const OwnedProblem scene = make_circle_scene(support::perturbed(CameraModelId::kCalibrated));
  const Careless function;
  Problem problem = scene.view();
  problem.camera_model = CameraModel(function);
  const Warnings warnings = warnings_of_failure(problem);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_EQ(warnings[0],
            "point " + std::to_string(scene.point_index[0]) +
                ": a derivative of its residual is not a finite number in camera " +
                std::to_string(scene.camera_index[0]) + ", observation 0 (240 such observations)");
  EXPECT_TRUE(std::isinf(check_jacobians(problem).worst_error));
}

// Heights of cameras, whose derivatives are not written.
class Heights final : public residuals::ResidualFunction {
 public:
  int rows() const override { return 1; }
  void evaluate(const double* poses, const double*, const Output& out) const override {
    for (int k = 0; k < 2; ++k) out.residuals[k] = poses[12 * k + 11];
  }
};

TEST(Warnings, DerivativesThatAResidualFunctionDoesNotWriteAreNamed) {
  OwnedProblem scene = make_circle_scene(support::perturbed(CameraModelId::kCalibrated));
  residuals::ConstraintGroup group{.name = "heights"};
  for (int camera : {2, 4}) group.members.push_back({.camera = camera});
  group.function = std::make_shared<Heights>();
  scene.constraints.add(group);
  EXPECT_EQ(warnings_of_failure(scene.view()),
            Warnings{"constraints['heights'][0]: a derivative of its residual is not a finite "
                     "number (2 such members)"});
}

}  // namespace
}  // namespace sfmcpp::ba::warnings_test

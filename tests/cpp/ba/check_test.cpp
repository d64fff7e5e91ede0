#include "sfmcpp/ba/check.hpp"

#include <algorithm>
#include <array>
#include <functional>
#include <limits>
#include <ostream>
#include <type_traits>

#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "support/refusal.hpp"
#include "support/small_scenes.hpp"

namespace sfmcpp::ba::check_test {
namespace {

using support::message_of;
using support::OwnedProblem;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// 6 cameras, 40 points, 240 observations with σ.
OwnedProblem legal_scene() {
  support::SceneOptions options;
  options.camera_model = CameraModelId::kBal;
  options.varied_sigma = true;
  return make_circle_scene(options);
}

std::string check(const OwnedProblem& scene) {
  return message_of([&] { check_arrays(scene.view()); });
}

TEST(CheckArrays, ALegalProblemPasses) { EXPECT_EQ(check(legal_scene()), "no error"); }

TEST(CheckArrays, NoSigmaMeansOnePixel) {
  OwnedProblem scene = legal_scene();
  scene.sigma_px.clear();
  EXPECT_EQ(check(scene), "no error");
}

struct Violation {
  const char* name;
  std::function<void(OwnedProblem&)> commit;
  const char* message;
};
void PrintTo(const Violation& violation, std::ostream* out) { *out << violation.name; }

class EveryViolation : public testing::TestWithParam<Violation> {};

TEST_P(EveryViolation, IsReportedWithArrayPositionValueAndRule) {
  OwnedProblem scene = legal_scene();
  GetParam().commit(scene);
  EXPECT_EQ(check(scene), GetParam().message);
}

const std::vector<Violation>& size_violations() {
  static const std::vector<Violation> violations{
      {"CamerasCut",
       [](OwnedProblem& s) { s.cameras.pop_back(); },
       "cameras: 71 values, must be a multiple of 12, as a camera has so many"},
      {"PointsCut",
       [](OwnedProblem& s) { s.points.pop_back(); },
       "points: 119 values, must be a multiple of 3, as a point has so many"},
      {"IntrinsicsNoWholeRow",
       [](OwnedProblem& s) { s.intrinsics.push_back(1.0); },
       "intrinsics: 19 values, must be a multiple of 3, as a row of intrinsics has so many"},
      {"IntrinsicsIndexShort",
       [](OwnedProblem& s) { s.intrinsics_index.pop_back(); },
       "intrinsics_index: 5 values, must be 6: 1 for each of 6 cameras"},
      {"PointIndexShort",
       [](OwnedProblem& s) { s.point_index.pop_back(); },
       "point_index: 239 values, must be 240: 1 for each of 240 observations in camera_index"},
      {"PixelsShort",
       [](OwnedProblem& s) { s.pixels.pop_back(); },
       "pixels: 479 values, must be 480: 2 for each of 240 observations in camera_index"},
      {"SigmaShort",
       [](OwnedProblem& s) { s.sigma_px.pop_back(); },
       "sigma_px: 239 values, must be 240: 1 for each of 240 observations in camera_index"},
      {"FixedCamerasShort",
       [](OwnedProblem& s) { s.fixed_cameras.pop_back(); },
       "fixed_cameras: 5 values, must be 6: 1 for each of 6 cameras"},
      {"FixedPointsLong",
       [](OwnedProblem& s) { s.fixed_points.push_back(0); },
       "fixed_points: 41 values, must be 40: 1 for each of 40 points"},
      {"FixedIntrinsicsShort",
       [](OwnedProblem& s) { s.fixed_intrinsics.pop_back(); },
       "fixed_intrinsics: 17 values, must be 18: 3 for each of 6 rows of intrinsics"}};
  return violations;
}

// Covariances in place of σ, of which the k-th is `values`.
std::vector<double>& covariance(OwnedProblem& scene, int k, std::array<double, 4> values) {
  scene.sigma_px.clear();
  for (int i = 0; i < 240; ++i)
    scene.covariance_px2.insert(scene.covariance_px2.end(), {2.0, 0.5, 0.5, 1.0});
  std::copy(values.begin(), values.end(), scene.covariance_px2.begin() + 4 * k);
  return scene.covariance_px2;
}

const std::vector<Violation>& value_violations() {
  static const std::vector<Violation> violations{
      {"IntrinsicsIndexTooLarge",
       [](OwnedProblem& s) { s.intrinsics_index[4] = 6; },
       "intrinsics_index[4] = 6: must be in [0, 6)"},
      {"CameraIndexNegative",
       [](OwnedProblem& s) { s.camera_index[17] = -1; },
       "camera_index[17] = -1: must be in [0, 6)"},
      {"CameraIndexTooLarge",
       [](OwnedProblem& s) { s.camera_index[0] = 6; },
       "camera_index[0] = 6: must be in [0, 6)"},
      {"PointIndexTooLarge",
       [](OwnedProblem& s) { s.point_index[239] = 40; },
       "point_index[239] = 40: must be in [0, 40)"},
      {"CamerasNaN",
       [](OwnedProblem& s) { s.cameras[12 * 3 + 5] = kNaN; },
       "cameras[3] = nan: must be finite"},
      {"IntrinsicsInfinite",
       [](OwnedProblem& s) { s.intrinsics[7] = kInfinity; },
       "intrinsics[2] = inf: must be finite"},
      {"PointsInfinite",
       [](OwnedProblem& s) { s.points[3 * 9 + 2] = -kInfinity; },
       "points[9] = -inf: must be finite"},
      {"PixelsNaN",
       [](OwnedProblem& s) { s.pixels[2 * 30 + 1] = kNaN; },
       "pixels[30] = nan: must be finite"},
      {"SigmaNaN",
       [](OwnedProblem& s) { s.sigma_px[5] = kNaN; },
       "sigma_px[5] = nan: must be finite"},
      {"SigmaZero",
       [](OwnedProblem& s) { s.sigma_px[5] = 0.0; },
       "sigma_px[5] = 0: must be positive"},
      {"SigmaNegative",
       [](OwnedProblem& s) { s.sigma_px[239] = -2.5; },
       "sigma_px[239] = -2.5: must be positive"},
      {"CovarianceBesideSigma",
       [](OwnedProblem& s) { s.covariance_px2.assign(960, 1.0); },
       "covariance_px2: given beside sigma_px, must be one of them"},
      {"CovarianceShort",
       [](OwnedProblem& s) {
         covariance(s, 7, {1, 0, 0, 1}).pop_back();
       },
       "covariance_px2: 959 values, must be 960"},
      {"CovarianceNaN",
       [](OwnedProblem& s) {
         covariance(s, 7, {1, kNaN, 0, 1});
       },
       "covariance_px2[7] = [[1, nan], [0, 1]]: must be finite"},
      {"CovarianceNotSymmetric",
       [](OwnedProblem& s) {
         covariance(s, 7, {1, 0.5, 0.4, 1});
       },
       "covariance_px2[7] = [[1, 0.5], [0.4, 1]]: must be symmetric"},
      {"CovarianceOfCorrelationOne",
       [](OwnedProblem& s) {
         covariance(s, 7, {0.01, 0.03, 0.03, 0.09});
       },
       "covariance_px2[7] = [[0.01, 0.03], [0.03, 0.09]]: must be positive definite"},
      {"CovarianceNegative",
       [](OwnedProblem& s) {
         covariance(s, 239, {-1, 0, 0, -1});
       },
       "covariance_px2[239] = [[-1, 0], [0, -1]]: must be positive definite"},
      {"CovarianceZero",
       [](OwnedProblem& s) {
         covariance(s, 0, {0, 0, 0, 0});
       },
       "covariance_px2[0] = [[0, 0], [0, 0]]: must be positive definite"}};
  return violations;
}

std::string name_of(const testing::TestParamInfo<Violation>& test) { return test.param.name; }
INSTANTIATE_TEST_SUITE_P(Sizes, EveryViolation, testing::ValuesIn(size_violations()), name_of);
INSTANTIATE_TEST_SUITE_P(Values, EveryViolation, testing::ValuesIn(value_violations()), name_of);

TEST(CheckArrays, AMatrixThatIsNoRotationIsReportedWithItsErrorAndDeterminant) {
  OwnedProblem scaled = legal_scene(), mirrored = legal_scene();
  for (int row = 0; row < 3; ++row) {
    for (int k = 0; k < 3; ++k) scaled.cameras[12 * 2 + 4 * row + k] *= 2.0;
    mirrored.cameras[12 * 5 + 4 * row] *= -1.0;
  }
  EXPECT_EQ(
      check(scaled),
      "cameras[2]: not a rotation: |R Rᵀ − I| = 3, determinant 8; must be orthonormal to 1e-6 with "
      "determinant 1");
  EXPECT_EQ(check(mirrored).substr(0, 26), "cameras[5]: not a rotation");
  EXPECT_NE(check(mirrored).find("determinant -1"), std::string::npos);
}

TEST(CheckArrays, RotationsMayBeOffByAMillionthAndNoMore) {
  OwnedProblem scene = legal_scene();
  const std::vector<double> exact = scene.cameras;
  for (const auto& [error, legal] : {std::pair{2e-7, true}, std::pair{2e-6, false}}) {
    for (int k : {0, 1, 2, 4, 5, 6, 8, 9, 10}) scene.cameras[k] = exact[k] * (1.0 + error);
    EXPECT_EQ(check(scene) == "no error", legal) << error;
  }
}

OwnedProblem projective_scene() {
  support::SceneOptions options;
  options.camera_model = CameraModelId::kProjective;
  return make_circle_scene(options);
}

TEST(CheckArrays, HomogeneousCoordinatesMayHaveAnyScaleButZero) {
  OwnedProblem scene = projective_scene();
  EXPECT_EQ(check(scene), "no error");
  for (double& x : scene.cameras) x *= -1e5;
  for (double& x : scene.points) x *= 1e-5;
  EXPECT_EQ(check(scene), "no error");
  std::fill_n(scene.points.begin() + 4 * 9, 4, 0.0);
  EXPECT_EQ(check(scene), "points[9]: homogeneous, must not be all zero");
  std::fill_n(scene.cameras.begin() + 12 * 5, 12, 0.0);
  EXPECT_EQ(check(scene), "cameras[5]: homogeneous, must not be all zero");
}

TEST(CheckArrays, PointsOfAProjectiveProblemHaveFourNumbers) {
  OwnedProblem scene = projective_scene();
  scene.points.pop_back();
  EXPECT_EQ(check(scene), "points: 159 values, must be a multiple of 4, as a point has so many");
}

TEST(CheckArrays, TheScaleOfAnImageFrameIsPositive) {
  for (double scale : {0.0, -400.0}) {
    OwnedProblem scene = projective_scene();
    scene.intrinsics[3 * 2] = scale;
    EXPECT_EQ(check(scene).substr(0, 22), "intrinsics[2]: scale =");
  }
}

linear::ObservationGraph graph_of(const OwnedProblem& scene) {
  const Problem p = scene.view();
  return linear::make_observation_graph(
      p.num_cameras(), p.num_points(), p.camera_index, p.point_index);
}

// Only sizes are looked at: there are no such arrays.
TEST(CheckSizes, MoreThanAnIntCanNumberAreRefused) {
  const OwnedProblem scene = legal_scene();
  constexpr std::size_t kTooMany = std::size_t{1} << 31;
  Problem problem = scene.view();
  problem.points = {problem.points.data(), 3 * kTooMany};
  EXPECT_EQ(message_of([&] { check_sizes(problem); }),
            "points: 6442450944 values, must be at most 3 · 2147483647");
  problem = scene.view();
  problem.camera_index = {problem.camera_index.data(), kTooMany};
  problem.point_index = {problem.point_index.data(), kTooMany};
  problem.pixels = {problem.pixels.data(), 2 * kTooMany};
  problem.sigma_px = {};
  EXPECT_EQ(message_of([&] { check_sizes(problem); }),
            "camera_index: 2147483648 values, must be at most 1 · 2147483647");
}

TEST(CheckSizes, AThirdOfThePointsThatAnIntCanNumberAreCountedRight) {
  const OwnedProblem scene = legal_scene();
  constexpr std::size_t kMany = 1'000'000'000;
  Problem problem = scene.view();
  problem.points = {problem.points.data(), 3 * kMany};
  EXPECT_EQ(problem.num_points(), kMany);
}

TEST(CheckDuplicates, NamesBothObservationsTheirCameraAndPoint) {
  OwnedProblem scene = legal_scene();
  EXPECT_NO_THROW(check_duplicates(scene.view(), graph_of(scene)));
  scene.camera_index[200] = scene.camera_index[31];
  scene.point_index[200] = scene.point_index[31];
  const std::string expected = "observations 31 and 200 are both of point " +
                               std::to_string(scene.point_index[31]) + " in camera " +
                               std::to_string(scene.camera_index[31]) + ": must be one";
  EXPECT_EQ(message_of([&] { check_duplicates(scene.view(), graph_of(scene)); }), expected);
}

TEST(CheckArrays, MasksThatAreNotGivenHoldNothing) {
  OwnedProblem scene = support::make_circle_scene(support::perturbed(CameraModelId::kPerspective));
  SolveOptions options;
  options.minimizer.termination.max_iterations = 3;
  const auto solved = [&] {
    optim::State state = state_of(scene.view());
    solve(scene.view(), options, {}, state);
    return state;
  };
  for (auto* mask : {&scene.fixed_cameras, &scene.fixed_points, &scene.fixed_intrinsics})
    std::fill(mask->begin(), mask->end(), 0);
  const optim::State given = solved();
  EXPECT_NE(given.cameras, scene.cameras);
  for (auto* mask : {&scene.fixed_cameras, &scene.fixed_points, &scene.fixed_intrinsics})
    mask->clear();
  const optim::State not_given = solved();
  EXPECT_EQ(not_given.cameras, given.cameras);
  EXPECT_EQ(not_given.points, given.points);
  EXPECT_EQ(not_given.intrinsics, given.intrinsics);
}

// What a solve says of a start that is not the problem's own.
std::string start(const std::function<void(optim::State&)>& change) {
  const OwnedProblem scene = legal_scene();
  const Problem problem = scene.view();
  optim::State state = state_of(problem);
  change(state);
  return message_of([&] { solve(problem, {}, {}, state); });
}

TEST(CheckStart, IsHeldToTheRulesOfTheProblem) {
  EXPECT_EQ(start([](optim::State& s) { s.points[7] += 0.01; }), "no error");
  EXPECT_EQ(start([](optim::State& s) { s.points[7] = kNaN; }),
            "state: points[2] = nan: must be finite");
  EXPECT_TRUE(start([](optim::State& s) {
                s.cameras[0] += 0.3;
              }).starts_with("state: cameras[0]: not a rotation"));
  EXPECT_EQ(start([](optim::State& s) { s.points.resize(119); }),
            "state.points: 119 values, must be 120 as in the problem");
}

TEST(CheckStart, CallbacksMustBeCallable) {
  const OwnedProblem scene = legal_scene();
  optim::State state = state_of(scene.view());
  optim::Events events;
  events.on_iteration = nullptr;
  EXPECT_EQ(message_of([&] { solve(scene.view(), {}, events, state); }),
            "events: on_start, on_iteration and poll must be callable");
}

TEST(CheckArrays, ANumberThatIsNoCameraModelIsRefused) {
  const OwnedProblem scene = legal_scene();
  Problem problem = scene.view();
  problem.camera_model = CameraModel(static_cast<CameraModelId>(17));
  EXPECT_EQ(message_of([&] { check_arrays(problem); }), "camera_model = 17: is none of its values");
}

#ifndef SFMCPP_CAMERA_PLUGIN
TEST(CheckArrays, AModelOfOnesOwnThatTheBuildLacksIsNamed) {
  const OwnedProblem scene = legal_scene();
  Problem problem = scene.view();
  problem.camera_model = CameraModelId::kPlugin;
  support::expect_refused([&] { check_arrays(problem); }, {"kPlugin", "SFMCPP_CAMERA_PLUGIN"});
}
#endif

// A camera model that is asked for its names alone.
class Named final : public CameraFunction {
 public:
  explicit Named(std::size_t count) : intrinsics_(count, "f") {}
  const std::string& name() const override { return name_; }
  std::span<const std::string_view> intrinsic_names() const override { return intrinsics_; }
  void image(int, const double*, const double*, double*, const Jacobians*) const override {}

 private:
  std::string name_ = "mine";
  std::vector<std::string_view> intrinsics_;
};

static_assert(std::is_constructible_v<CameraModel, const Named&>);
static_assert(!std::is_constructible_v<CameraModel, Named>, "it would be gone before the model");

TEST(CheckArrays, AFunctionHasAsManyIntrinsicsAsACameraHasRoomFor) {
  for (std::size_t count : {0, 13, 100}) {
    const Named function(count);
    Problem problem;
    problem.camera_model = CameraModel(function);
    EXPECT_EQ(message_of([&] { check_arrays(problem); }),
              "camera_model 'mine': " + std::to_string(count) + " intrinsics, must be 1 to 12");
  }
  const Named function(12);
  Problem problem;
  problem.camera_model = CameraModel(function);
  EXPECT_EQ(message_of([&] { check_arrays(problem); }), "no error");
}

}  // namespace
}  // namespace sfmcpp::ba::check_test

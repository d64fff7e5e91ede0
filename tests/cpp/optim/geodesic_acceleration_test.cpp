#include "sfmcpp/optim/geodesic_acceleration.hpp"

#include <array>
#include <cmath>
#include <span>
#include <vector>

#include <gtest/gtest.h>

#include "sfmcpp/optim/minimizer.hpp"
#include "support/linearized_problem.hpp"

namespace sfmcpp::optim::geodesic_acceleration_test {
namespace {

MinimizerOptions with(Acceleration kind) {
  MinimizerOptions options;
  options.acceleration = kind;
  return options;
}

TEST(GeodesicAcceleration, AutoLeavesOtherMethodsAndLineSearchesAlone) {
  MinimizerOptions options = with(Acceleration::kAuto);
  EXPECT_TRUE(GeodesicAcceleration(options).is_possible());
  options.method = Method::kDogLeg;
  EXPECT_FALSE(GeodesicAcceleration(options).is_possible());
  options.method = Method::kLevenbergMarquardt;
  options.line_search.kind = LineSearchKind::kGlobalAlgebraic;
  EXPECT_FALSE(GeodesicAcceleration(options).is_possible());
}

class AcceleratedMinimiser : public testing::TestWithParam<CameraModelId> {
 protected:
  // Exact observations, from a start so far off that residuals bend.
  static support::SceneOptions exact() {
    support::SceneOptions scene = support::perturbed(GetParam());
    scene.noise_px = 0.0;
    scene.point_error_m *= 3.0;
    return scene;
  }
  MinimizerSummary run(Acceleration kind) {
    support::LinearizedProblem work{make_circle_scene(exact())};
    MinimizerOptions options = with(kind);
    options.termination.function_tolerance = 1e-12;
    const auto solver =
        linear::make_linear_solver(work.normal(), {linear::LinearSolverKind::kDense});
    const Stopwatch clock;
    return minimize(work.model, *solver, options, {}, clock, work.state);
  }
  // Steps until the cost is a millionth of the first.
  static int steps(const MinimizerSummary& summary) {
    for (const Iteration& now : summary.iterations) {
      if (now.cost < 1e-6 * summary.initial_cost) return now.number;
    }
    return 1000;
  }
};

double squared_length(std::span<const double> x, std::span<const double> diagonal) {
  double sum = 0.0;
  for (std::size_t k = 0; k < x.size(); ++k) sum += x[k] * x[k] * diagonal[k];
  return sum;
}

// √(½ a / v) in the norm of JᵀJ's diagonal.
double half_acceleration(std::span<const double> step,
                         std::span<const double> bent,
                         std::span<const double> diagonal) {
  std::vector<double> difference(bent.begin(), bent.end());
  for (std::size_t k = 0; k < step.size(); ++k) difference[k] -= step[k];
  return std::sqrt(squared_length(difference, diagonal) / squared_length(step, diagonal));
}

// Of steps that are long enough for some to bend by more than they move, and for some to do not.
TEST_P(AcceleratedMinimiser, NoPointAndNoCameraIsAcceleratedByMoreThanAShareOfItsStep) {
  constexpr double kMost = 0.35;
  support::LinearizedProblem work{make_circle_scene(exact())};
  const auto solver = linear::make_linear_solver(work.normal(), {linear::LinearSolverKind::kDense});
  linear::Step step;
  const linear::Damping damping{1e-6, linear::DampingMatrix::kDiagonal};
  ASSERT_TRUE(solver->solve(damping, step, [] { return false; }).success);
  const std::vector<double> diagonal =
      work.normal().camera_damping({1.0, linear::DampingMatrix::kDiagonal});
  GeodesicAcceleration acceleration(with(Acceleration::kGeodesic));
  std::array<int, 2> points{}, cameras{};  // that bend less, and as much as they may
  const auto examine = [&](double share, std::array<int, 2>& counts) {
    EXPECT_LE(share, kMost * (1.0 + 1e-9));
    ++counts[share > kMost * (1.0 - 1e-9)];
  };
  for (double longer : {1.0, 100.0}) {
    linear::Step longer_step = step;
    for (auto* numbers : {&longer_step.camera, &longer_step.point})
      for (double& x : *numbers) x *= longer;
    const linear::Step* bent = acceleration.bend(work.model, *solver, work.state, longer_step);
    ASSERT_NE(bent, nullptr);
    for (int p = 0; p < work.graph.num_points; ++p) {
      const auto at = 3 * static_cast<std::size_t>(p);
      examine(half_acceleration(std::span(longer_step.point).subspan(at, 3),
                                std::span(bent->point).subspan(at, 3),
                                work.normal().point_block(p).diagonal()),
              points);
    }
    for (int block = 0; block < work.map.num_blocks(); ++block) {
      const auto at = static_cast<std::size_t>(work.map.block_begin[block]);
      const auto size = static_cast<std::size_t>(work.map.block_begin[block + 1]) - at;
      examine(half_acceleration(std::span(longer_step.camera).subspan(at, size),
                                std::span(bent->camera).subspan(at, size),
                                std::span(diagonal).subspan(at, size)),
              cameras);
    }
  }
  for (const std::array<int, 2>& counts : {points, cameras}) {
    EXPECT_GT(counts[0], 0);
    EXPECT_GT(counts[1], 0);
  }
}

TEST_P(AcceleratedMinimiser, ComesToTheExactSolutionInNoMoreSteps) {
  const int straight = steps(run(Acceleration::kNone));
  EXPECT_LT(straight, 1000);
  for (Acceleration kind : {Acceleration::kAuto, Acceleration::kPoints, Acceleration::kGeodesic}) {
    const MinimizerSummary summary = run(kind);
    EXPECT_LE(steps(summary), straight) << enum_name(kind);
    EXPECT_LT(summary.final_cost, 1e-10 * summary.initial_cost) << enum_name(kind);
    int accelerated = 0;
    for (const Iteration& now : summary.iterations) accelerated += now.accelerated;
    EXPECT_GT(accelerated, 0) << enum_name(kind);
  }
}

INSTANTIATE_TEST_SUITE_P(Models,
                         AcceleratedMinimiser,
                         testing::Values(CameraModelId::kCalibrated,
                                         CameraModelId::kBal,
                                         CameraModelId::kPerspective),
                         [](const auto& test) { return std::string(enum_name(test.param)); });

}  // namespace
}  // namespace sfmcpp::optim::geodesic_acceleration_test

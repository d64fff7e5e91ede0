// Weight selection for one pose: 100 weights, 40 observations, one core (thesis table 5.3).
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include <benchmark/benchmark.h>

#include "sfmcpp/ba/pose_refinement.hpp"
#include "sfmcpp/math/so3.hpp"

namespace sfmcpp::bench {
namespace {

constexpr int kObservations = 40;
constexpr int kWeights = 100;
using Kind = residuals::ConstraintKind;

// A camera that looks along z from the origin at points 4 to 40 m away, one pixel of noise, and a
// gyro or odometer that is a little wrong.
struct Scene {
  explicit Scene(Kind kind) {
    for (int j = 0; j < kObservations; ++j) add_observation();
    weights.push_back(0.0);
    for (int k = 0; k < kWeights - 1; ++k)
      weights.push_back(std::pow(10.0, -3.0 + 6.0 * k / (kWeights - 2)));
    constraint.constraint = {.kind = kind,
                             .rotation = exp_so3({0.003, -0.002, 0.004}),
                             .translation = {0.02, -0.01, 1.03},
                             .distance = 1.03,
                             .points = points,
                             .intrinsics = intrinsics};
    constraint.previous = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -1};
  }

  void add_observation() {
    const double depth = 4.0 + 36.0 * uniform(random);
    const double x = uniform(random) - 0.5, y = 0.6 * (uniform(random) - 0.5);
    points.insert(points.end(), {x * depth, y * depth, depth});
    pixels.push_back(intrinsics[0] * x + intrinsics[2] + noise(random));
    pixels.push_back(intrinsics[0] * y + intrinsics[3] + noise(random));
  }

  ba::PoseSweep sweep(const ba::PoseSweepOptions& options) const {
    const ba::PoseView view{CameraModelId::kCalibrated, intrinsics, points, pixels, {}};
    return ba::sweep_pose_weights(view, {&constraint, 1}, 0, weights, start.data(), options);
  }

  std::mt19937 random{3};
  std::uniform_real_distribution<double> uniform;
  std::normal_distribution<double> noise;
  std::array<double, 5> intrinsics{720.0, 1.0, 600.0, 180.0, 0.0};
  std::array<double, 12> start{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  std::vector<double> points, pixels, weights;
  ba::WeightedConstraint constraint;
};

bool all_finite(const std::vector<double>& values) {
  for (double x : values) {
    if (!std::isfinite(x)) return false;
  }
  return true;
}

void run(benchmark::State& state, Kind kind, bool exact, bool approximate) {
  const Scene scene(kind);
  const ba::PoseSweepOptions options{.leave_one_out = exact,
                                     .approximate_leave_one_out = approximate};
  ba::PoseSweep sweep;
  for (auto _ : state) benchmark::DoNotOptimize(sweep = scene.sweep(options));
  const bool good = all_finite(sweep.constraint) && all_finite(sweep.leave_one_out) &&
                    all_finite(sweep.approximate_leave_one_out);
  if (!good) state.SkipWithError("a score is not finite");
}

void trade_off(benchmark::State& state, Kind kind) { run(state, kind, false, false); }
void leave_one_out(benchmark::State& state, Kind kind) { run(state, kind, true, false); }
void approximate_leave_one_out(benchmark::State& state, Kind kind) {
  run(state, kind, false, true);
}

#define SFMCPP_BENCH_KINDS(function)                                                           \
  BENCHMARK_CAPTURE(function, orientation, Kind::kOrientation)->Unit(benchmark::kMillisecond); \
  BENCHMARK_CAPTURE(function, scale, Kind::kScale)->Unit(benchmark::kMillisecond);             \
  BENCHMARK_CAPTURE(function, pose, Kind::kDisplacementPose)->Unit(benchmark::kMillisecond);   \
  BENCHMARK_CAPTURE(function, reprojections, Kind::kOrientationReprojections)                  \
      ->Unit(benchmark::kMillisecond)

SFMCPP_BENCH_KINDS(trade_off);
SFMCPP_BENCH_KINDS(leave_one_out);
SFMCPP_BENCH_KINDS(approximate_leave_one_out);

}  // namespace
}  // namespace sfmcpp::bench

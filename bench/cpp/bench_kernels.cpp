// Projection and linearisation, per camera model.
#include <cmath>

#include <benchmark/benchmark.h>

#include "bench_scene.hpp"

namespace sfmcpp::bench {
namespace {

using Bench = support::LinearizedProblem;

void count_observations(benchmark::State& state, const Bench& bench) {
  state.counters["observations/s"] =
      benchmark::Counter(static_cast<double>(bench.graph.num_observations()),
                         benchmark::Counter::kIsIterationInvariantRate);
}

void cost(benchmark::State& state, CameraModelId model) {
  const auto scene = make_scene(model);
  Bench bench(scene, false, static_cast<int>(state.range(0)));
  double value = 0.0;
  for (auto _ : state) benchmark::DoNotOptimize(value = bench.model.cost(bench.state));
  if (!(value > 0.0) || !std::isfinite(value))
    state.SkipWithError("the cost is not a positive number");
  count_observations(state, bench);
}

void linearize(benchmark::State& state, CameraModelId model) {
  const auto scene = make_scene(model);
  Bench bench(scene, false, static_cast<int>(state.range(0)));
  for (auto _ : state) bench.model.linearize(bench.state);
  const double gradient = bench.model.normal_equations().gradient_max_norm();
  if (!(gradient > 0.0) || !std::isfinite(gradient))
    state.SkipWithError("the gradient is not a positive number");
  count_observations(state, bench);
}

BENCHMARK_CAPTURE(cost, calibrated, CameraModelId::kCalibrated)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(cost, perspective, CameraModelId::kPerspective)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(cost, bal, CameraModelId::kBal)->Arg(1)->Arg(2)->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(cost, projective, CameraModelId::kProjective)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(linearize, calibrated, CameraModelId::kCalibrated)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(linearize, perspective, CameraModelId::kPerspective)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(linearize, bal, CameraModelId::kBal)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(linearize, projective, CameraModelId::kProjective)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace sfmcpp::bench

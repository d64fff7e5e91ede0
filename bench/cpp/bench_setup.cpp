// What is not a step: parallel regions that are empty or uneven, what a solve does before its first
// step, and the local adjustment of SLAM.
#include <benchmark/benchmark.h>

#include "allocations.hpp"
#include "bench_scene.hpp"
#include "sfmcpp/ba/solve.hpp"

namespace sfmcpp::bench {
namespace {

void empty_region(benchmark::State& state) {
  ThreadPool pool(static_cast<int>(state.range(0)));
  for (auto _ : state) pool.parallel_for(64, [](int task) { benchmark::DoNotOptimize(task); });
}

// One task of 64 takes as long as all others together.
void uneven_region(benchmark::State& state) {
  ThreadPool pool(static_cast<int>(state.range(0)));
  std::vector<double> sums(64);
  for (auto _ : state) {
    pool.parallel_for(64, [&](int task) {
      double sum = 0.0;
      for (int k = 0; k < (task == 0 ? 63 : 1) * 500; ++k) benchmark::DoNotOptimize(sum += k);
      sums[task] = sum;
    });
  }
}

void observation_graph(benchmark::State& state) {
  const auto scene = make_scene();
  const ba::Problem problem = scene.view();
  for (auto _ : state) benchmark::DoNotOptimize(ba::graph_of(problem).num_observations());
  state.counters["observations/s"] =
      benchmark::Counter(problem.num_observations(), benchmark::Counter::kIsIterationInvariantRate);
}

// Eight free keyframes, four fixed ones, 300 points that five of them see.
support::OwnedProblem local_scene() {
  auto scene = make_scene(CameraModelId::kCalibrated, 12, 300, 5);
  for (int i = 0; i < 4; ++i) scene.fixed_cameras[i] = 1;
  return scene;
}

void local_adjustment(benchmark::State& state) {
  const auto scene = local_scene();
  const ba::Problem problem = scene.view();
  ba::SolveOptions options;
  options.num_threads = 1;
  options.loss = LossKind::kHuber;
  options.loss_scale_px = 2.0;
  options.minimizer.termination.max_iterations = 10;
  options.minimizer.termination.function_tolerance = 1e-4;
  ba::SolveSummary summary;
  const long before = num_allocations();
  for (auto _ : state) {
    optim::State unknowns = ba::state_of(problem);
    summary = ba::solve(problem, options, {}, unknowns);
  }
  if (summary.minimizer.termination != optim::Termination::kConverged)
    state.SkipWithError("not converged");
  state.counters["iterations"] = static_cast<double>(summary.minimizer.iterations.size()) - 1;
  state.counters["observations"] = problem.num_observations();
  state.counters["allocations"] =
      static_cast<double>(num_allocations() - before) / static_cast<double>(state.iterations());
}

BENCHMARK(empty_region)->Arg(1)->Arg(2)->UseRealTime();
BENCHMARK(uneven_region)->Arg(1)->Arg(2)->UseRealTime();
BENCHMARK(observation_graph)->Unit(benchmark::kMicrosecond);
BENCHMARK(local_adjustment)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace sfmcpp::bench

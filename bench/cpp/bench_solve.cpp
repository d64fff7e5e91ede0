// A whole solve, checks and set-up included.
#include <benchmark/benchmark.h>

#include "bench_scene.hpp"
#include "sfmcpp/ba/solve.hpp"

namespace sfmcpp::bench {
namespace {

using Bench = support::LinearizedProblem;

void whole_solve(benchmark::State& state, optim::Method method) {
  const auto scene = make_scene();
  const ba::Problem problem = scene.view();
  ba::SolveOptions options;
  options.minimizer.method = method;
  options.num_threads = static_cast<int>(state.range(0));
  ba::SolveSummary summary;
  for (auto _ : state) {
    optim::State unknowns = ba::state_of(problem);
    summary = ba::solve(problem, options, {}, unknowns);
  }
  if (summary.minimizer.termination != optim::Termination::kConverged)
    state.SkipWithError("not converged");
  state.counters["iterations"] = static_cast<double>(summary.minimizer.iterations.size()) - 1;
}

void set_up_and_linearize(benchmark::State& state) {
  const auto scene = make_scene();
  for (auto _ : state) benchmark::DoNotOptimize(Bench(scene).graph.num_observations());
}

BENCHMARK_CAPTURE(whole_solve, lm, optim::Method::kLevenbergMarquardt)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(whole_solve, lm_nielsen, optim::Method::kLevenbergMarquardtNielsen)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMillisecond);
BENCHMARK(set_up_and_linearize)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace sfmcpp::bench

// The nine sums of the algebraic line search, beside the rest of a Levenberg–Marquardt iteration.
#include <cmath>

#include <benchmark/benchmark.h>

#include "bench_scene.hpp"
#include "sfmcpp/linear/linear_solver.hpp"

namespace sfmcpp::bench {
namespace {

using Bench = support::LinearizedProblem;

struct Stepped {
  Stepped(CameraModelId model, int threads)
      : scene(make_scene(model)), work(scene, false, threads) {
    work.model.linearize(work.state);
    solver = linear::make_linear_solver(work.model.normal_equations(),
                                        {linear::LinearSolverKind::kDense});
    solve();
  }
  void solve() {
    solver->solve({1e-4}, step, [] { return false; });
  }

  support::OwnedProblem scene;
  Bench work;
  std::unique_ptr<linear::LinearSolver> solver;
  linear::Step step;
};

void algebraic_sums(benchmark::State& state, CameraModelId model) {
  Stepped at(model, static_cast<int>(state.range(0)));
  Biquadratic sums;
  for (auto _ : state)
    benchmark::DoNotOptimize(sums = *at.work.model.algebraic_cost(at.work.state, at.step));
  if (!std::isfinite(sums.value(1.0, 1.0))) state.SkipWithError("the sums are not finite");
}

// Linearise, solve, move, evaluate: what every iteration does.
void lm_iteration(benchmark::State& state, CameraModelId model) {
  Stepped at(model, static_cast<int>(state.range(0)));
  optim::State candidate = at.work.state;
  double cost = 0.0;
  for (auto _ : state) {
    at.work.model.linearize(at.work.state);
    at.solve();
    at.work.model.plus(at.work.state, at.step, {}, candidate);
    benchmark::DoNotOptimize(cost = at.work.model.cost(candidate));
  }
  if (!std::isfinite(cost)) state.SkipWithError("the cost is not finite");
}

BENCHMARK_CAPTURE(algebraic_sums, calibrated, CameraModelId::kCalibrated)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(algebraic_sums, bal, CameraModelId::kBal)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(lm_iteration, calibrated, CameraModelId::kCalibrated)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(lm_iteration, bal, CameraModelId::kBal)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace sfmcpp::bench

// One damped solve of the normal equations, per linear solver, on a ring of cameras (a banded Schur
// complement) and on cameras that all see each other's points (a full one).
#include <benchmark/benchmark.h>

#include "bench_scene.hpp"
#include "sfmcpp/linear/dense_cholesky.hpp"
#include "sfmcpp/linear/linear_solver.hpp"

namespace sfmcpp::bench {
namespace {

using Bench = support::LinearizedProblem;

using linear::LinearSolverKind;

void solve(benchmark::State& state, LinearSolverKind kind, const support::OwnedProblem& scene) {
  Bench bench(scene, false, static_cast<int>(state.range(0)));
  bench.model.linearize(bench.state);
  const auto solver = linear::make_linear_solver(bench.model.normal_equations(), {.kind = kind});
  const linear::Damping damping{1e-4};
  linear::Step step;
  linear::LinearSolveResult result;
  for (auto _ : state) result = solver->solve(damping, step, [] { return false; });
  if (!result.success || bench.model.normal_equations().predicted_decrease(step, damping) <= 0.0) {
    state.SkipWithError("the step does not promise a decrease");
  }
  state.counters["columns"] = bench.map.num_columns;
  state.counters["cg"] = result.iterations;
}

void ring(benchmark::State& state, LinearSolverKind kind) {
  solve(state, kind, make_scene(CameraModelId::kBal, 200, 20000, 4));
}
void full(benchmark::State& state, LinearSolverKind kind) { solve(state, kind, make_scene()); }

void dense_cholesky(benchmark::State& state) {
  const int n = static_cast<int>(state.range(0));
  ThreadPool pool(static_cast<int>(state.range(1)));
  linear::DenseCholesky cholesky(n);
  bool ok = true;
  for (auto _ : state) {
    state.PauseTiming();
    cholesky.set_zero(pool);
    for (int k = 0; k < n; ++k) cholesky.at(k, k) = n;
    state.ResumeTiming();
    ok = cholesky.factorize(pool);
  }
  if (!ok) state.SkipWithError("a positive definite matrix was refused");
  state.counters["flop/s"] =
      benchmark::Counter(1.0 * n * n * n / 3, benchmark::Counter::kIsIterationInvariantRate);
}

BENCHMARK_CAPTURE(full, dense, LinearSolverKind::kDense)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(full, sparse, LinearSolverKind::kSparse)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(full, iterative, LinearSolverKind::kIterative)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(ring, dense, LinearSolverKind::kDense)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(ring, sparse, LinearSolverKind::kSparse)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(ring, iterative, LinearSolverKind::kIterative)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMillisecond);
BENCHMARK(dense_cholesky)->ArgsProduct({{450, 1800}, {1, 2}})->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace sfmcpp::bench

// Sparse Cholesky factorisations, ours and CHOLMOD's in the same order: a city (cameras spread over
// a square that meet all others nearby), a corridor, and a loop whose cameras share intrinsics.
#include <algorithm>
#include <cmath>
#include <random>

#include <benchmark/benchmark.h>

#include "cholmod.hpp"
#include "sfmcpp/linear/supernodal_cholesky.hpp"

namespace sfmcpp::bench {
namespace {

using linear::BlockGraph;
using linear::BlockPlace;
using linear::Supernodes;

constexpr int kCameraColumns = 9;

BlockGraph city(int cameras) {
  constexpr double kNeighbours = 75;
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  std::vector<std::pair<double, double>> at;
  for (int k = 0; k < cameras; ++k) at.emplace_back(unit(random), unit(random));
  std::sort(at.begin(), at.end());
  const double radius = std::sqrt(kNeighbours / (3.14159 * cameras));
  BlockGraph graph{.size = std::vector<int>(cameras, kCameraColumns), .edges = {}};
  for (int a = 0; a < cameras; ++a) {
    for (int b = a + 1; b < cameras && at[b].first - at[a].first < radius; ++b) {
      if (std::hypot(at[b].first - at[a].first, at[b].second - at[a].second) < radius)
        graph.edges.emplace_back(a, b);
    }
  }
  return graph;
}

BlockGraph corridor(int cameras) {
  constexpr int kNeighbours = 20;
  BlockGraph graph{.size = std::vector<int>(cameras, kCameraColumns), .edges = {}};
  for (int a = 0; a < cameras; ++a) {
    for (int b = a + 1; b < std::min(cameras, a + kNeighbours); ++b) graph.edges.emplace_back(a, b);
  }
  return graph;
}

BlockGraph loop_with_shared_intrinsics(int cameras) {
  BlockGraph graph = corridor(cameras);
  graph.size.push_back(3);
  for (int a = 0; a < cameras; ++a) {
    if (a < 10) graph.edges.emplace_back(a, cameras - 10 + a);
    graph.edges.emplace_back(a, cameras);
  }
  std::sort(graph.edges.begin(), graph.edges.end());
  return graph;
}

// Some number for an entry, small enough for `diagonal` to dominate.
double entry(int row, int column) { return 0.01 * std::sin(row + 3.0 * column); }
constexpr double kDiagonal = 100.0;

template <class F>
void for_each_block(const BlockGraph& graph, const Supernodes& s, const F& f) {
  for (int k = 0; k < static_cast<int>(graph.size.size()); ++k) f(k, k);
  for (const auto& [a, b] : graph.edges)
    f(std::max(s.position[a], s.position[b]), std::min(s.position[a], s.position[b]));
}

void fill(const BlockGraph& graph,
          const Supernodes& s,
          linear::SupernodalCholesky& cholesky,
          ThreadPool& pool) {
  cholesky.set_zero(pool);
  for_each_block(graph, s, [&](int row, int column) {
    const BlockPlace place = cholesky.place(row, column);
    for (int c = s.first_column[column]; c < s.first_column[column + 1]; ++c) {
      for (int r = std::max(c, s.first_column[row]); r < s.first_column[row + 1]; ++r)
        cholesky.values()[place.of(r - s.first_column[row], c - s.first_column[column])] =
            r == c ? kDiagonal : entry(r, c);
    }
  });
}

SparseLower compressed(const BlockGraph& graph, const Supernodes& s) {
  std::vector<std::vector<int>> rows(graph.size.size());
  for_each_block(graph, s, [&](int row, int column) { rows[column].push_back(row); });
  SparseLower lower;
  for (int k = 0; k < static_cast<int>(rows.size()); ++k) {
    std::sort(rows[k].begin(), rows[k].end());
    for (int c = s.first_column[k]; c < s.first_column[k + 1]; ++c) {
      for (int row : rows[k]) {
        for (int r = std::max(c, s.first_column[row]); r < s.first_column[row + 1]; ++r) {
          lower.row.push_back(r);
          lower.value.push_back(r == c ? kDiagonal : entry(r, c));
        }
      }
      lower.column_begin.push_back(static_cast<std::int64_t>(lower.row.size()));
    }
  }
  return lower;
}

void report(benchmark::State& state, const linear::BlockOrdering& ordering, bool ok) {
  if (!ok) state.SkipWithError("a positive definite matrix was refused");
  state.counters["flop/s"] =
      benchmark::Counter(ordering.flops, benchmark::Counter::kIsIterationInvariantRate);
  state.counters["factor_MB"] = 8e-6 * ordering.factor_entries;
}

void ours(benchmark::State& state, BlockGraph (*shape)(int)) {
  const BlockGraph graph = shape(static_cast<int>(state.range(0)));
  ThreadPool pool(static_cast<int>(state.range(1)));
  const linear::BlockOrdering ordering = linear::order_blocks(graph, pool);
  const Supernodes supernodes = linear::make_supernodes(graph, ordering);
  linear::SupernodalCholesky cholesky(supernodes);
  bool ok = true;
  for (auto _ : state) {
    state.PauseTiming();
    fill(graph, supernodes, cholesky, pool);
    state.ResumeTiming();
    ok = cholesky.factorize(pool);
  }
  report(state, ordering, ok);
}

void ordering(benchmark::State& state, BlockGraph (*shape)(int)) {
  const BlockGraph graph = shape(static_cast<int>(state.range(0)));
  ThreadPool alone(1);
  for (auto _ : state)
    benchmark::DoNotOptimize(linear::make_supernodes(graph, linear::order_blocks(graph, alone)));
}

// OpenBLAS takes as many threads as OPENBLAS_NUM_THREADS says.
void cholmod(benchmark::State& state, BlockGraph (*shape)(int)) {
  const BlockGraph graph = shape(static_cast<int>(state.range(0)));
  ThreadPool alone(1);
  const linear::BlockOrdering order = linear::order_blocks(graph, alone);
  const SparseLower matrix = compressed(graph, linear::make_supernodes(graph, order));
  Cholmod factor(matrix);
  bool ok = true;
  for (auto _ : state) ok = factor.factorize(matrix);
  report(state, order, ok);
}

void sizes(benchmark::internal::Benchmark* bench) {
  bench->ArgsProduct({{1000, 3000}, {1, 2}})->Unit(benchmark::kMillisecond)->UseRealTime();
}
void cholmod_sizes(benchmark::internal::Benchmark* bench) {
  bench->Arg(1000)->Arg(3000)->Unit(benchmark::kMillisecond)->UseRealTime();
}

BENCHMARK_CAPTURE(ours, city, city)->Apply(sizes);
BENCHMARK_CAPTURE(cholmod, city, city)->Apply(cholmod_sizes);
BENCHMARK_CAPTURE(ordering, city, city)->Apply(cholmod_sizes);
BENCHMARK_CAPTURE(ours, corridor, corridor)->Apply(sizes);
BENCHMARK_CAPTURE(cholmod, corridor, corridor)->Apply(cholmod_sizes);
BENCHMARK_CAPTURE(ours, loop, loop_with_shared_intrinsics)->Apply(sizes);
BENCHMARK_CAPTURE(cholmod, loop, loop_with_shared_intrinsics)->Apply(cholmod_sizes);

}  // namespace
}  // namespace sfmcpp::bench

// A fixed number of steps on a fixed scene, for a linear solver by name: what bench/counts.py
// counts the instructions, data references and cache misses of, with what operator new was asked
// for meanwhile.
//
//     sfmcpp_counts SOLVER STEPS
#include <array>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <new>
#include <optional>
#include <string_view>

#include "bench_scene.hpp"
#include "sfmcpp/ba/solve.hpp"
#include "sfmcpp/core/enum_names.hpp"

namespace {

// One thread: nothing here has to be atomic.
std::uint64_t allocations = 0;
std::uint64_t allocated_bytes = 0;

void* counted(std::size_t size, std::size_t alignment) {
  ++allocations;
  allocated_bytes += size;
  const std::size_t rounded = (size + alignment - 1) / alignment * alignment;
  void* const place = std::aligned_alloc(alignment, rounded == 0 ? alignment : rounded);
  if (place == nullptr) throw std::bad_alloc();
  return place;
}

}  // namespace

// All other forms of new and delete call these.
void* operator new(std::size_t size) { return counted(size, __STDCPP_DEFAULT_NEW_ALIGNMENT__); }
void* operator new(std::size_t size, std::align_val_t alignment) {
  return counted(size, static_cast<std::size_t>(alignment));
}
void operator delete(void* place) noexcept { std::free(place); }
void operator delete(void* place, std::size_t) noexcept { std::free(place); }
void operator delete(void* place, std::align_val_t) noexcept { std::free(place); }
void operator delete(void* place, std::size_t, std::align_val_t) noexcept { std::free(place); }

namespace sfmcpp::bench {
namespace {

support::OwnedProblem scene_for(linear::LinearSolverKind kind) {
  // Cameras that nearly all meet for the dense solver, a ring of them for the others.
  return kind == linear::LinearSolverKind::kDense ? make_scene(CameraModelId::kBal, 24, 2000, 6)
                                                  : make_scene(CameraModelId::kBal, 100, 3000, 4);
}

int run(std::string_view solver, int steps) {
  const auto kind = parse_enum<linear::LinearSolverKind>(solver);
  const auto scene = scene_for(kind);
  const ba::Problem problem = scene.view();
  ba::SolveOptions options;
  options.linear_solver.kind = kind;
  options.num_threads = 1;
  options.minimizer.termination.max_iterations = steps;
  options.minimizer.termination.function_tolerance = 0.0;
  options.minimizer.termination.gradient_tolerance = 0.0;
  options.minimizer.termination.parameter_tolerance = 0.0;
  optim::State unknowns = ba::state_of(problem);
  const auto calls_before = allocations;
  const auto bytes_before = allocated_bytes;
  const ba::SolveSummary summary = ba::solve(problem, options, {}, unknowns);
  const auto calls = allocations - calls_before;
  const auto bytes = allocated_bytes - bytes_before;
  const auto taken = summary.minimizer.iterations.size() - 1;
  std::printf(
      "{\"compiler\": \"%s\", \"steps\": %zu, \"allocations\": %llu, \"allocated_bytes\": %llu, "
      "\"observations\": %zu}\n",
      __VERSION__,
      taken,
      static_cast<unsigned long long>(calls),
      static_cast<unsigned long long>(bytes),
      static_cast<std::size_t>(problem.num_observations()));
  return taken == static_cast<std::size_t>(steps) ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace
}  // namespace sfmcpp::bench

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: sfmcpp_counts SOLVER STEPS\n");
    return EXIT_FAILURE;
  }
  try {
    return sfmcpp::bench::run(argv[1], std::atoi(argv[2]));
  } catch (const std::exception& error) {
    std::fprintf(stderr, "sfmcpp_counts: %s\n", error.what());
    return EXIT_FAILURE;
  }
}

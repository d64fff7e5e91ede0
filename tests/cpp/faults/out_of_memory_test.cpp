// Memory that runs out at any one allocation ends a solve with std::bad_alloc, or is done without:
// nothing is lost, and the next solve has the same bits.
#include <new>
#include <ostream>

#include <gtest/gtest.h>

#include "faults/failing_memory.hpp"
#include "sfmcpp/ba/solve.hpp"
#include "sfmcpp/core/buffer_store.hpp"
#include "support/random_constraints.hpp"

namespace sfmcpp::faults::out_of_memory_test {
namespace {

using ba::SolveOptions;
using linear::LinearSolverKind;
using optim::State;
using support::OwnedProblem;

// From here on arrays of solves come from operator new, one by one, and not from the store.
void fill_the_store() {
  for (std::size_t bytes = std::size_t{64} << 20; bytes >= kCacheLine; bytes /= 2) {
    while (BufferStore::of_process().allocate(bytes) != nullptr) {
    }
  }
}

struct Case {
  const char* name;
  LinearSolverKind solver;
  CameraModelId model = CameraModelId::kBal;
  optim::LineSearchKind search = optim::LineSearchKind::kNone;
  bool constrained = false;
  int threads = 1;
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

// The sanitizers slow every allocation down by a factor of ten.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr long kStride = 11;
#else
constexpr long kStride = 1;
#endif

class OutOfMemory : public testing::TestWithParam<Case> {
 protected:
  static void SetUpTestSuite() { fill_the_store(); }

  static OwnedProblem scene() {
    support::SceneOptions options = support::perturbed(GetParam().model);
    options.num_cameras = 4;
    options.num_points = 12;
    OwnedProblem problem = make_circle_scene(options);
    if (!GetParam().constrained) return problem;
    for (const residuals::ConstraintKind kind : support::pose_constraint_kinds())
      problem.constraints.add(random_group(problem, kind, {{0, 1}, {2, 3}}));
    return problem;
  }

  static void solve(const OwnedProblem& problem, State& state) {
    SolveOptions options;
    options.num_threads = GetParam().threads;
    options.linear_solver.kind = GetParam().solver;
    options.minimizer.line_search.kind = GetParam().search;
    options.minimizer.termination.max_iterations = 2;
    ba::solve(problem.view(), options, {}, state);
  }

  static State solved(const OwnedProblem& problem) {
    State state = state_of(problem.view());
    solve(problem, state);
    return state;
  }
};

bool operator==(const OwnedProblem& a, const OwnedProblem& b) {
  return a.cameras == b.cameras && a.intrinsics == b.intrinsics && a.points == b.points &&
         a.pixels == b.pixels && a.camera_index == b.camera_index;
}

void expect_same_bits(const State& a, const State& b, long number) {
  EXPECT_EQ(a.cameras, b.cameras) << "allocation " << number;
  EXPECT_EQ(a.intrinsics, b.intrinsics) << "allocation " << number;
  EXPECT_EQ(a.points, b.points) << "allocation " << number;
}

TEST_P(OutOfMemory, AtAnyAllocationOfASolveIsAnErrorOrDoneWithout) {
  const OwnedProblem problem = scene(), before = problem;
  const State reference = solved(problem);
  long refused = 0;
  for (long number = 0;; number += kStride) {
    const long live = live_allocations();
    bool has_failed = false;
    {
      State state = state_of(problem.view());
      FailingMemory memory(number);
      try {
        solve(problem, state);
        expect_same_bits(state, reference, number);
      } catch (const std::bad_alloc&) {
        ++refused;
        EXPECT_EQ(state.points.size(), problem.points.size());
      }
      has_failed = memory.has_failed();
    }
    ASSERT_EQ(live_allocations(), live) << "allocation " << number << " leaves something behind";
    if (!has_failed) break;
    if (number % 10 == 0) expect_same_bits(solved(problem), reference, number);
  }
  EXPECT_GT(refused * kStride, 100);
  EXPECT_TRUE(problem == before);
}

INSTANTIATE_TEST_SUITE_P(
    Solves,
    OutOfMemory,
    testing::Values(
        Case{"Dense", LinearSolverKind::kDense},
        Case{"Sparse", LinearSolverKind::kSparse},
        Case{"Iterative", LinearSolverKind::kIterative},
        Case{"DenseProjectiveSearched",
             LinearSolverKind::kDense,
             CameraModelId::kProjective,
             optim::LineSearchKind::kTwoWayAlgebraic},
        Case{.name = "DenseConstrained", .solver = LinearSolverKind::kDense, .constrained = true},
        Case{.name = "SparseConstrained", .solver = LinearSolverKind::kSparse, .constrained = true},
        Case{.name = "IterativeConstrained",
             .solver = LinearSolverKind::kIterative,
             .constrained = true},
        Case{.name = "DenseThreads", .solver = LinearSolverKind::kDense, .threads = 3},
        Case{.name = "SparseConstrainedThreads",
             .solver = LinearSolverKind::kSparse,
             .constrained = true,
             .threads = 3},
        Case{.name = "IterativeThreads", .solver = LinearSolverKind::kIterative, .threads = 3}),
    [](const auto& test) { return test.param.name; });

TEST(StoreWithoutAddressSpace, HasNoRoomAndOwnsNothing) {
  const FailingMemory memory(0);
  BufferStore store(std::size_t{1} << 20);
  ASSERT_TRUE(memory.has_failed());
  char other = 0;
  EXPECT_EQ(store.allocate(1), nullptr);
  EXPECT_FALSE(store.take_back(&other, 1));
}

}  // namespace
}  // namespace sfmcpp::faults::out_of_memory_test

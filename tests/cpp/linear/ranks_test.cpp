// Two ranks, each with half of the points, against one with all.
#include <cmath>

#include <gtest/gtest.h>

#include "../../../cpp/src/linear/iterative_solver.hpp"
#include "sfmcpp/linear/block_diagonal.hpp"
#include "sfmcpp/linear/step_algebra.hpp"
#include "support/fused_products.hpp"
#include "support/random_system.hpp"
#include "support/threaded_exchange.hpp"

namespace sfmcpp::linear::ranks_test {
namespace {

using support::RandomSystem;

constexpr int kRanks = 2;
constexpr LinearSolverKind kSolvers[] = {
    LinearSolverKind::kDense, LinearSolverKind::kSparse, LinearSolverKind::kIterative};

// The part of a step that a rank has.
Step part_of(const Step& whole, int rank) {
  Step part{.camera = whole.camera, .point = {}};
  for (std::size_t p = rank; 3 * p < whole.point.size(); p += kRanks) {
    part.point.insert(
        part.point.end(), whole.point.begin() + 3 * p, whole.point.begin() + 3 * p + 3);
  }
  return part;
}

double largest_difference(const std::vector<double>& a, const std::vector<double>& b) {
  EXPECT_EQ(a.size(), b.size());
  double difference = 0.0, size = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) {
    difference = std::max(difference, std::abs(a[k] - b[k]));
    size = std::max(size, std::abs(b[k]));
  }
  return size > 0.0 ? difference / size : difference;
}

std::vector<support::SystemOptions> systems() {
  std::vector<support::SystemOptions> result = support::random_systems();
  for (support::SystemOptions& options : result) options.pairs = {{1, 1}, {0, 4}, {5, 3}};
  return result;
}

class Ranks : public testing::TestWithParam<support::SystemOptions> {
 protected:
  // compute(system) on one rank and on two; equal(mine, whole, rank) compares.
  template <class Compute, class Compare>
  void compare(const Compute& compute, const Compare& equal) const {
    const RandomSystem alone(GetParam());
    const auto whole = compute(alone);
    std::vector<decltype(compute(alone))> parts(kRanks);
    support::play_ranks(kRanks, [&](Exchange& exchange) {
      const RandomSystem part(GetParam(), exchange);
      parts[exchange.rank()] = compute(part);
    });
    for (int rank = 0; rank < kRanks; ++rank) equal(parts[rank], whole, rank);
  }
  static Step own_part(const RandomSystem& system, unsigned seed) {
    const Step whole = support::random_step(make_map(GetParam()), seed);
    return system.normal().exchange().num_ranks() == 1
               ? whole
               : part_of(whole, system.normal().exchange().rank());
  }
};

TEST_P(Ranks, HaveTheNumbersOfTheWholeInTheNormalEquations) {
  const auto numbers = [](const RandomSystem& system) {
    const NormalEquations& normal = system.normal();
    std::vector<double> result = normal.camera_rhs();
    result.insert(result.end(), normal.camera_diagonal().begin(), normal.camera_diagonal().end());
    const Step x = own_part(system, 1), y = own_part(system, 2);
    const Step metric = damping_entries(normal, DampingMatrix::kDiagonal);
    const Damping damping{1e-3, DampingMatrix::kDiagonal};
    for (double value : {normal.gradient_max_norm(),
                         normal.max_diagonal(),
                         normal.slopes(x).camera,
                         normal.slopes(x).point,
                         normal.curvature(x),
                         normal.model_decrease(x),
                         normal.predicted_decrease(x, damping),
                         dot(normal, x, y),
                         dot(normal, x, metric, y),
                         norm(normal, x)}) {
      result.push_back(value);
    }
    return result;
  };
  compare(numbers, [](const auto& mine, const auto& whole, int) {
    ASSERT_EQ(mine.size(), whole.size());
    for (std::size_t k = 0; k < mine.size(); ++k)
      EXPECT_NEAR(mine[k], whole[k], 1e-11 * std::abs(whole[k]) + 1e-9) << k;
  });
}

TEST_P(Ranks, SolveForTheStepOfTheWhole) {
  for (LinearSolverKind kind : kSolvers) {
    const auto step_of = [&](const RandomSystem& system) {
      Step step;
      EXPECT_TRUE(
          system.solve({kind, 1e-12, 5000}, {1e-3, DampingMatrix::kDiagonal}, step).success);
      return step;
    };
    std::vector<double> first;
    compare(step_of, [&](const Step& mine, const Step& whole, int rank) {
      SCOPED_TRACE(enum_name(kind));
      EXPECT_LT(largest_difference(mine.camera, whole.camera), 1e-8);
      EXPECT_LT(largest_difference(mine.point, part_of(whole, rank).point), 1e-8);
      if (rank == 0) first = mine.camera;
      EXPECT_EQ(mine.camera, first) << "the ranks have drifted apart";
    });
  }
}

using Structure = std::shared_ptr<const ReducedStructure>;

// solve(system) on one rank has the bits that it has on several, in either precision.
template <class Solve>
void expect_bits_of_the_whole(support::SystemOptions options, const Solve& solve) {
  if (!support::products_are_fused()) GTEST_SKIP() << "products are rounded before they are added";
  options.compensated = true;
  for (const Precision stored : {Precision::kDouble, Precision::kSingle}) {
    options.stored = stored;
    const std::vector<double> whole = solve(RandomSystem(options));
    for (int ranks = 2; ranks <= 4; ++ranks) {
      support::play_ranks(ranks, [&](Exchange& exchange) {
        EXPECT_EQ(solve(RandomSystem(options, exchange)), whole) << ranks << " ranks";
      });
    }
  }
}

std::vector<double> cameras_of_step(const RandomSystem& system, const Structure& structure) {
  IterativeSolver solver(system.normal(), {.kind = LinearSolverKind::kIterative}, structure);
  Step step;
  EXPECT_TRUE(solver.solve({1e-6, DampingMatrix::kDiagonal}, step, [] { return false; }).success);
  return step.camera;
}

TEST_P(Ranks, HaveTheBitsOfTheWholeInConjugateGradientsOverBlocks) {
  expect_bits_of_the_whole(GetParam(), [](const RandomSystem& system) {
    const NormalEquations& normal = system.normal();
    return cameras_of_step(system,
                           std::make_shared<ReducedStructure>(ReducedStructure{
                               .pattern = make_global_camera_pattern(
                                   system.graph, {}, normal.pool(), normal.exchange())}));
  });
}

TEST_P(Ranks, HaveTheBitsOfTheWholeInConjugateGradientsFromTheJacobian) {
  expect_bits_of_the_whole(
      GetParam(), [](const RandomSystem& system) { return cameras_of_step(system, nullptr); });
}

TEST_P(Ranks, SweepAndPreconditionAsTheWhole) {
  const auto steps = [](const RandomSystem& system) {
    BlockJacobi jacobi(system.normal());
    jacobi.factor({1e-3, DampingMatrix::kDiagonal});
    Step swept, solved;
    jacobi.sweep(swept);
    jacobi.solve(negative_gradient(system.normal()), solved);
    return std::pair(swept, solved);
  };
  compare(steps, [](const auto& mine, const auto& whole, int rank) {
    for (const auto& [a, b] : {std::pair(mine.first, whole.first), {mine.second, whole.second}}) {
      EXPECT_LT(largest_difference(a.camera, b.camera), 1e-9);
      EXPECT_LT(largest_difference(a.point, part_of(b, rank).point), 1e-9);
    }
  });
}

// Pairs of cameras that only the points of the other rank relate are there too.
TEST_P(Ranks, KnowWhichCamerasMeetOnAnyRank) {
  const auto pattern = [](const RandomSystem& system) {
    return make_global_camera_pattern(
        system.graph, {{0, 4}}, system.normal().pool(), system.normal().exchange());
  };
  compare(pattern, [](const CameraPattern& mine, const CameraPattern& whole, int) {
    EXPECT_EQ(mine.row_begin, whole.row_begin);
    EXPECT_EQ(mine.column, whole.column);
  });
}

TEST_P(Ranks, ChooseTheSolverOfTheWhole) {
  const auto choice = [](const RandomSystem& system) {
    return choose_linear_solver({.graph = system.graph,
                                 .map = system.map,
                                 .pool = system.normal().pool(),
                                 .pairs = {},
                                 .exchange = system.normal().exchange()},
                                {})
        .reason;
  };
  compare(choice, [](const auto& mine, const auto& whole, int) { EXPECT_EQ(mine, whole); });
}

TEST_P(Ranks, ShareTheMemoryOfTheirMachine) {
  const auto budget = [](const RandomSystem& system) {
    return choose_linear_solver({.graph = system.graph,
                                 .map = system.map,
                                 .pool = system.normal().pool(),
                                 .pairs = {},
                                 .exchange = system.normal().exchange()},
                                {})
        .budget_bytes;
  };
  compare(budget, [](double mine, double whole, int) { EXPECT_EQ(kRanks * mine, whole); });
}

INSTANTIATE_TEST_SUITE_P(Systems, Ranks, testing::ValuesIn(systems()), [](const auto& test) {
  return test.param.name;
});

}  // namespace
}  // namespace sfmcpp::linear::ranks_test

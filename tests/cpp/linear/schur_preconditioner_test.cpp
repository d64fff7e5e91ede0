// Every preconditioner of the iterative solver, with S formed in blocks.
#include "../../../cpp/src/linear/schur_preconditioner.hpp"

#include <cmath>
#include <map>
#include <string>
#include <utility>

#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

#include "../../../cpp/src/linear/iterative_solver.hpp"
#include "support/fused_products.hpp"
#include "support/random_system.hpp"
#include "support/threaded_exchange.hpp"

namespace sfmcpp::linear::schur_preconditioner_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using support::RandomSystem;
using support::SystemOptions;

constexpr Damping kDamping{1e-3, DampingMatrix::kDiagonal};

// Of all ranks.
std::shared_ptr<const ReducedStructure> structure_of(const RandomSystem& system) {
  return std::make_shared<ReducedStructure>(
      ReducedStructure{.pattern = make_global_camera_pattern(
                           system.graph, {}, system.normal().pool(), system.normal().exchange())});
}

// As many modes as a camera has columns but two, at random.
void set_modes(RandomSystem& system) {
  CameraModes& modes = system.camera_modes();
  const int size = system.map.camera_size;
  modes.count = size - 2;
  modes.values.resize(static_cast<std::size_t>(system.graph.num_cameras) * size * modes.count);
  std::mt19937 random(5);
  for (double& value : modes.values) value = std::normal_distribution()(random);
}

// Two dozen cameras and more, so that there is more than one cluster; some systems with shared
// columns, fixed cameras and residuals of cameras alone.
std::vector<SystemOptions> systems() {
  return {
      {.name = "Strip", .cameras = 100, .points = 400, .camera_size = 6, .window = 5},
      {.name = "Shared",
       .cameras = 80,
       .points = 250,
       .camera_size = 9,
       .padding = 1,
       .shared = 2,
       .groups = 2,
       .window = 6},
      {.name = "FixedAndPairs",
       .cameras = 70,
       .points = 200,
       .camera_size = 9,
       .window = 6,
       .fixed_cameras = {0, 33},
       .fixed_columns = {{1, 2}},
       .pairs = {{1, 1}, {2, 40}, {5, 6}}},
      {.name = "AllSeeAll", .cameras = 12, .points = 40, .camera_size = 12},
  };
}

struct DenseReference {
  support::DenseSystem system;
  VectorXd step;
};

// Of a system by its name: the factorisation of hundreds of dense columns serves all tests.
const DenseReference& reference_of(SystemOptions options) {
  static std::map<std::string, DenseReference> known;
  const auto found = known.find(options.name);
  if (found != known.end()) return found->second;
  options.dense = true;
  const RandomSystem system(options);
  return known[options.name] = {system.dense(), solve_by_qr(system.dense(), kDamping)};
}

class Preconditioners
    : public testing::TestWithParam<std::tuple<SystemOptions, PreconditionerKind>> {
 protected:
  Preconditioners() { set_modes(system); }
  static SystemOptions options() {
    SystemOptions result = std::get<0>(GetParam());
    result.dense = false;
    return result;
  }
  static PreconditionerKind kind() { return std::get<1>(GetParam()); }

  static LinearSolveResult solve(RandomSystem& of, double tolerance, Step& step) {
    IterativeSolver solver(of.normal(),
                           {.kind = LinearSolverKind::kIterative,
                            .pcg_tolerance = tolerance,
                            .pcg_max_iterations = 5000,
                            .preconditioner = kind()},
                           structure_of(of));
    return solver.solve(kDamping, step, [] { return false; });
  }

  RandomSystem system{options()};
};

TEST_P(Preconditioners, LeadToTheStepOfTheDenseSystem) {
  Step step;
  ASSERT_TRUE(solve(system, 1e-10, step).success);
  const DenseReference reference = reference_of(options());
  EXPECT_LT((flatten(reference.system, step) - reference.step).norm(),
            1e-6 * reference.step.norm());
}

TEST_P(Preconditioners, AreSymmetricAndPositiveDefinite) {
  PointElimination elimination(system.normal());
  elimination.factor(kDamping);
  const auto structure = structure_of(system);
  const CameraGroups groups = group_cameras(system.normal(), &structure->pattern, kind());
  const CameraPartition shares(
      system.normal(), groups.clusters, std::vector<double>(system.graph.num_cameras, 1.0));
  BlockSparseSchur schur(system.normal(), elimination, shares, structure);
  SchurPreconditioner preconditioner(system.normal(), &schur, shares, groups, structure);
  std::vector<double> rhs;
  schur.form(preconditioner.diagonal());
  schur.gather(preconditioner.diagonal(), rhs);
  preconditioner.factor(system.normal().camera_damping(kDamping));
  const int n = system.map.num_columns;
  MatrixXd inverse(n, n);
  for (int k = 0; k < n; ++k) {
    std::vector<double> unit(n, 0.0), column(n);
    unit[k] = 1.0;
    preconditioner.solve(unit, column);
    inverse.col(k) = Eigen::Map<VectorXd>(column.data(), n);
  }
  EXPECT_LT((inverse - inverse.transpose()).norm(), 1e-4 * inverse.norm());
  const MatrixXd symmetric = 0.5 * (inverse + inverse.transpose());
  EXPECT_GT(Eigen::SelfAdjointEigenSolver<MatrixXd>(symmetric).eigenvalues()[0], 0.0);
}

// Each rank has a share of the clusters and of the points. Rows are rounded to single precision
// when they are whole: nothing but the last digits of sums hangs on how many ranks there are.
TEST_P(Preconditioners, AreThoseOfOneRankOnSeveral) {
  struct Answer {
    int iterations;
    std::vector<double> camera;
  };
  const auto answer_of = [](RandomSystem& of) {
    set_modes(of);
    Step step;
    const LinearSolveResult result = solve(of, 1e-3, step);
    EXPECT_TRUE(result.success);
    return Answer{result.iterations, step.camera};
  };
  const Answer alone = answer_of(system);
  for (int ranks : {2, 3}) {
    std::vector<Answer> answers(ranks);
    support::play_ranks(ranks, [&](Exchange& exchange) {
      RandomSystem part(options(), exchange);
      answers[exchange.rank()] = answer_of(part);
    });
    for (const Answer& answer : answers) {
      EXPECT_EQ(answer.iterations, alone.iterations);
      EXPECT_EQ(answer.camera, answers[0].camera) << "the ranks have drifted apart";
      const auto size = static_cast<Eigen::Index>(alone.camera.size());
      const Eigen::Map<const VectorXd> mine(answer.camera.data(), size),
          whole(alone.camera.data(), size);
      EXPECT_LT((mine - whole).norm(), 1e-9 * whole.norm());
    }
  }
}

// However points are divided; below 1e-4 residuals are corrected from the Jacobian.
TEST_P(Preconditioners, HaveTheBitsOfOneRankOnSeveral) {
  if (!support::products_are_fused()) GTEST_SKIP() << "products are rounded before they are added";
  SystemOptions compensated = options();
  compensated.compensated = true;
  for (const double tolerance : {1e-3, 1e-9}) {
    const auto answer_of = [&](Exchange& exchange) {
      RandomSystem part(compensated, exchange);
      set_modes(part);
      Step step;
      const LinearSolveResult result = solve(part, tolerance, step);
      EXPECT_TRUE(result.success);
      return std::pair(result.iterations, step.camera);
    };
    const auto alone = answer_of(this_process());
    for (int ranks : {2, 3}) {
      support::play_ranks(ranks, [&](Exchange& exchange) {
        EXPECT_EQ(answer_of(exchange), alone) << ranks << " ranks, " << tolerance;
      });
    }
  }
}

TEST_P(Preconditioners, LeadToTheStepOfTheDenseSystemOnTwoRanks) {
  const VectorXd reference = reference_of(options()).step.head(system.map.num_columns);
  support::play_ranks(2, [&](Exchange& exchange) {
    RandomSystem part(options(), exchange);
    set_modes(part);
    Step step;
    EXPECT_TRUE(solve(part, 1e-10, step).success);
    const Eigen::Map<const VectorXd> mine(step.camera.data(), reference.size());
    EXPECT_LT((mine - reference).norm(), 1e-6 * reference.norm());
  });
}

TEST_P(Preconditioners, HaveTheSameBitsForAnyNumberOfThreads) {
  Step first;
  for (int threads : {1, 2, 4}) {
    SystemOptions of_threads = options();
    of_threads.threads = threads;
    RandomSystem threaded(of_threads);
    set_modes(threaded);
    Step step;
    ASSERT_TRUE(solve(threaded, 1e-3, step).success);
    if (threads == 1) first = step;
    EXPECT_EQ(step.camera, first.camera);
    EXPECT_EQ(step.point, first.point);
  }
}

INSTANTIATE_TEST_SUITE_P(Systems,
                         Preconditioners,
                         testing::Combine(testing::ValuesIn(systems()),
                                          testing::Values(PreconditionerKind::kSchurJacobi,
                                                          PreconditionerKind::kClusters,
                                                          PreconditionerKind::kTwoLevels)),
                         [](const auto& test) {
                           std::string name(enum_name(std::get<1>(test.param)));
                           std::erase(name, '-');
                           return std::get<0>(test.param).name + "_" + name;
                         });

// A chain of cameras in which an error of one end reaches the other but by neighbours.
TEST(PreconditionersOfAChain, OfLargerPartsTakeFewerIterations) {
  RandomSystem chain(
      {.cameras = 300, .points = 1500, .camera_size = 6, .window = 4, .dense = false});
  set_modes(chain);
  int previous = 1 << 20;
  for (PreconditionerKind kind :
       {PreconditionerKind::kSchurJacobi, PreconditionerKind::kClusters}) {
    IterativeSolver solver(
        chain.normal(),
        {.kind = LinearSolverKind::kIterative, .pcg_tolerance = 1e-3, .preconditioner = kind},
        structure_of(chain));
    Step step;
    const int iterations =
        solver.solve({1e-6, DampingMatrix::kDiagonal}, step, [] { return false; }).iterations;
    EXPECT_LT(iterations, previous);
    previous = iterations;
  }
}

class CoarseSpaceLater : public testing::Test {
 protected:
  CoarseSpaceLater() { set_modes(chain_); }
  IterativeSolver make(PreconditionerKind kind) const {
    return {chain_.normal(),
            {.kind = LinearSolverKind::kIterative, .pcg_tolerance = 1e-9, .preconditioner = kind},
            structure_of(chain_)};
  }
  static Step solve(IterativeSolver& solver) {
    Step step;
    EXPECT_TRUE(solver.solve({1e-6, DampingMatrix::kDiagonal}, step, [] { return false; }).success);
    return step;
  }

  RandomSystem chain_{
      {.cameras = 520, .points = 1600, .camera_size = 6, .window = 2, .dense = false}};
};

TEST_F(CoarseSpaceLater, ComesInAfterAStepOfManyIterations) {
  IterativeSolver by_itself = make(PreconditionerKind::kAuto);
  IterativeSolver clusters = make(PreconditionerKind::kClusters);
  IterativeSolver two_levels = make(PreconditionerKind::kTwoLevels);
  const Step of_one_level = solve(clusters), of_two_levels = solve(two_levels);
  ASSERT_NE(of_one_level.camera, of_two_levels.camera);
  EXPECT_EQ(solve(by_itself).camera, of_one_level.camera);
  ASSERT_GT(by_itself.iterations_of_solves().at(0), 20);
  EXPECT_EQ(solve(by_itself).camera, of_two_levels.camera);
  EXPECT_EQ(solve(clusters).camera, of_one_level.camera);
}

TEST_F(CoarseSpaceLater, ComesInFromTheIterationsOfEarlierSolves) {
  IterativeSolver solver = make(PreconditionerKind::kAuto);
  IterativeSolver replayed = make(PreconditionerKind::kAuto);
  solve(solver);
  replayed.replay(solver.iterations_of_solves());
  EXPECT_EQ(solve(replayed).camera, solve(solver).camera);
  EXPECT_EQ(replayed.iterations_of_solves(), solver.iterations_of_solves());
}

}  // namespace
}  // namespace sfmcpp::linear::schur_preconditioner_test

// An iterative solver that hands over to a direct one.
#include <gtest/gtest.h>

#include "sfmcpp/linear/linear_solver.hpp"
#include "support/random_system.hpp"

namespace sfmcpp::linear::changing_solver_test {
namespace {

using support::RandomSystem;

const Damping kDamping{1e-3, DampingMatrix::kDiagonal};

class ChangingSolver : public testing::Test {
 protected:
  // As if the choice had expected few iterations.
  LinearSolverChoice choice(double budget_bytes) const {
    return {.kind = LinearSolverKind::kIterative,
            .counts = {.cameras = 6,
                       .points = 30,
                       .observations = 180,
                       .pairs = 450,
                       .camera_size = 6,
                       .columns = 36,
                       .blocks = 21},
            .budget_bytes = budget_bytes};
  }
  std::unique_ptr<LinearSolver> make(double tolerance, double budget_bytes = 1e12) const {
    return make_chosen_solver(system_.normal(), {.pcg_tolerance = tolerance}, choice(budget_bytes));
  }
  Step solve(LinearSolver& solver) const {
    Step step;
    EXPECT_TRUE(solver.solve(kDamping, step, [] { return false; }).success);
    return step;
  }
  Step dense_step() const {
    Step step;
    system_.solve({.kind = LinearSolverKind::kDense}, kDamping, step);
    return step;
  }

  RandomSystem system_{{.name = "all see all"}};
};

TEST_F(ChangingSolver, HandsOverToADirectOneWhereStepsTakeManyIterations) {
  const auto solver = make(1e-14);
  solve(*solver);
  ASSERT_EQ(solver->changes().size(), 1u);
  EXPECT_EQ(solver->changes()[0].solves, 1);
  EXPECT_EQ(solver->changes()[0].kind, LinearSolverKind::kDense);
  const Step step = solve(*solver), expected = dense_step();
  for (std::size_t k = 0; k < step.camera.size(); ++k)
    EXPECT_EQ(step.camera[k], expected.camera[k]);
  EXPECT_EQ(solver->changes().size(), 1u);
}

TEST_F(ChangingSolver, CutsAStepShortThatCostsMoreThanThoseOfAnother) {
  const RandomSystem row{{.name = "three see each", .cameras = 40, .points = 200, .window = 3}};
  const LinearSolverOptions options{.pcg_tolerance = 1e-14};
  const auto iterations = [&](const LinearSolverChoice& choice) {
    const auto solver = make_chosen_solver(row.normal(), options, choice);
    solve(*solver);
    return solver->iterations_of_solves().at(0);
  };
  EXPECT_GT(iterations(choice(1e3)), 20) << "there is no memory for another";
  EXPECT_EQ(iterations(choice(1e12)), 20) << "the fewest, where another costs next to nothing";
}

TEST_F(ChangingSolver, HasNoFactorsOfAStepThatAnotherHasMade) {
  const auto solver = make(1e-14);
  EXPECT_FALSE(solver->can_solve_again(Unknowns::kAll));
  solve(*solver);
  ASSERT_EQ(solver->changes().size(), 1u);
  for (Unknowns unknowns : {Unknowns::kAll, Unknowns::kPoints})
    EXPECT_FALSE(solver->can_solve_again(unknowns));
  solve(*solver);
  for (Unknowns unknowns : {Unknowns::kAll, Unknowns::kPoints})
    EXPECT_TRUE(solver->can_solve_again(unknowns));
}

// A few iterations with few blocks are cheaper than a dense factor.
TEST_F(ChangingSolver, StaysWhereAnotherWouldCostMore) {
  LinearSolverChoice loose = choice(1e12);
  loose.with_blocks = true;
  loose.counts.cameras = 50;
  loose.counts.columns = 300;
  loose.counts.blocks = 100;
  const auto solver = make_chosen_solver(system_.normal(), {.pcg_tolerance = 1e-2}, loose);
  for (int k = 0; k < 3; ++k) solve(*solver);
  EXPECT_TRUE(solver->changes().empty());
}

TEST_F(ChangingSolver, GoesOnWithTheSameBitsFromTheIterationsOfItsSolves) {
  for (double tolerance : {1e-14, 1e-2}) {
    const auto solver = make(tolerance);
    for (int k = 0; k < 3; ++k) {
      const auto replayed = make(tolerance);
      replayed->replay(solver->iterations_of_solves());
      EXPECT_EQ(replayed->changes().size(), solver->changes().size());
      const Step step = solve(*replayed), expected = solve(*solver);
      EXPECT_EQ(step.camera, expected.camera);
      EXPECT_EQ(step.point, expected.point);
      EXPECT_EQ(replayed->iterations_of_solves(), solver->iterations_of_solves());
    }
  }
}

TEST_F(ChangingSolver, StaysWhereThereIsNoMemoryForAnother) {
  const auto solver = make(1e-14, 1e3);
  for (int k = 0; k < 3; ++k) solve(*solver);
  EXPECT_TRUE(solver->changes().empty());
}

TEST_F(ChangingSolver, OneAskedForByNameStays) {
  const auto solver =
      make_chosen_solver(system_.normal(),
                         {.kind = LinearSolverKind::kIterative, .pcg_tolerance = 1e-14},
                         choice(1e12));
  solve(*solver);
  EXPECT_TRUE(solver->changes().empty());
}

}  // namespace
}  // namespace sfmcpp::linear::changing_solver_test

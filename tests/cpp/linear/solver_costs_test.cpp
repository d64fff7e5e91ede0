// The cost model; only the measurement of this machine has a clock.
#include "sfmcpp/linear/solver_costs.hpp"

#include <chrono>
#include <thread>

#include <gtest/gtest.h>

#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/linear/reduced_structure.hpp"
#include "support/random_system.hpp"

namespace sfmcpp::linear::solver_costs_test {
namespace {

const SolverCounts kCounts{.cameras = 100,
                           .points = 5000,
                           .observations = 30000,
                           .pairs = 90000,
                           .camera_size = 9,
                           .columns = 900,
                           .blocks = 1500,
                           .edges = 1400,
                           .factor_flops = 1e7,
                           .factor_entries = 2e5};

TEST(SolverCosts, FlopsAreThoseOfTheFactorisationAndOfWhatFormsTheMatrix) {
  const double formed = 30000 * (4 * 81 + 20 * 9 + 200) + 90000 * (4 * 81 + 8 * 9 + 12);
  EXPECT_DOUBLE_EQ(forecast_dense(kCounts).flops(), formed + 900.0 * 900 * 900 / 3);
  EXPECT_DOUBLE_EQ(forecast_sparse(kCounts).flops(), formed + 1e7);
}

TEST(SolverCosts, SecondsAreAmountsTimesRates) {
  Works rates{};
  amount_of(rates, Work::kPairs) = 2.0;
  EXPECT_DOUBLE_EQ(forecast_dense(kCounts).seconds(rates),
                   2.0 * amount_of(forecast_dense(kCounts).step, Work::kPairs));
  EXPECT_EQ(forecast_iterative(kCounts, false).seconds(rates), 0.0);
}

TEST(SolverCosts, WorkDoneOnceCountsInPart) {
  Works rates{};
  amount_of(rates, Work::kSymbolic) = 1.0;
  const SolverForecast sparse = forecast_sparse(kCounts);
  EXPECT_EQ(sparse.seconds(rates), 0.0);
  EXPECT_GT(sparse.seconds_to_compare(rates), 0.0);
  EXPECT_LT(sparse.seconds_to_compare(rates), 1400.0);
}

TEST(SolverCosts, ProductsWithBlocksReadTheBlocksInsteadOfTheJacobian) {
  SolverCounts twice = kCounts;
  twice.observations *= 2;
  const auto bytes = [](const SolverCounts& counts, bool with_blocks) {
    return amount_of(forecast_iterative(counts, with_blocks).iteration,
                     with_blocks ? Work::kBlockProduct : Work::kProduct);
  };
  EXPECT_GT(bytes(twice, false), 1.5 * bytes(kCounts, false));
  EXPECT_EQ(bytes(twice, true), bytes(kCounts, true));
}

TEST(SolverCosts, EveryKindOfWorkHasARate) {
  for (double seconds : reference_rates()) EXPECT_GT(seconds, 0.0);
}

TEST(SolverCosts, AMeasurementThatWasStoppedIsMadeAgain) {
  ThreadPool pool(7);  // of so many threads there is no other
  {
    const StopWatcher watcher(pool, [] { return true; });
    std::this_thread::sleep_for(std::chrono::milliseconds(250));
    EXPECT_THROW(rates_of_this_machine(pool), Stopped);
  }
  EXPECT_NE(rates_of_this_machine(pool), reference_rates());
}

class Bound : public testing::TestWithParam<support::SystemOptions> {};

// Of cameras with one variable block each.
TEST_P(Bound, OfTheSparseFactorIsBelowTheFactor) {
  ThreadPool pool(1);
  const ParameterMap map = make_map(GetParam());
  CameraPattern pattern = make_camera_pattern(make_graph(GetParam()), {}, pool);
  SolverCounts counts{.cameras = static_cast<double>(pattern.num_rows()),
                      .columns = static_cast<double>(map.num_columns),
                      .blocks = static_cast<double>(pattern.num_blocks())};
  bound_sparse_factor(counts);
  const ReducedStructure structure = make_sparse_structure(std::move(pattern), map, pool);
  EXPECT_LE(counts.factor_flops, structure.ordering.flops);
  EXPECT_LE(counts.factor_entries, structure.ordering.factor_entries);
  EXPECT_GT(counts.factor_flops, 0.05 * structure.ordering.flops) << "it would tell nothing";
}

INSTANTIATE_TEST_SUITE_P(
    Shapes,
    Bound,
    testing::Values(
        support::SystemOptions{.name = "ring", .cameras = 60, .points = 600, .window = 3},
        support::SystemOptions{.name = "wide", .cameras = 60, .points = 600, .window = 20},
        support::SystemOptions{.name = "full", .cameras = 30, .points = 100},
        support::SystemOptions{
            .name = "random",
            .cameras = 80,
            .points = 200,
            .sees = [](int i, int p) { return (i * 7919 + p * 104729) % 31 < 2; }}),
    [](const auto& test) { return test.param.name; });

}  // namespace
}  // namespace sfmcpp::linear::solver_costs_test

// Cameras, columns and rows of S on the ranks that they belong to.
#include "../../../cpp/src/linear/rank_partition.hpp"

#include <algorithm>
#include <utility>

#include <gtest/gtest.h>

#include "../../../cpp/src/linear/schur_operator.hpp"
#include "../../../cpp/src/linear/schur_preconditioner.hpp"
#include "support/fused_products.hpp"
#include "support/random_system.hpp"
#include "support/threaded_exchange.hpp"

namespace sfmcpp::linear::camera_shares_test {
namespace {

using support::RandomSystem;
using support::SystemOptions;

constexpr int kCameras = 200, kPoints = 1000, kWindow = 4;

// Points in turn along a chain; those of even number, which rank 0 of two has, see its first half.
SystemOptions chain_in_halves() {
  const auto sees = [](int camera, int point) {
    const int place = (point % 2 * kPoints + point) / 2 * kCameras / kPoints;
    return camera >= place && camera < place + kWindow;
  };
  return {.cameras = kCameras, .points = kPoints, .camera_size = 6, .sees = sees, .dense = false};
}

// Points of both ranks along all of a chain, each seen by many cameras: half of all rows are sent.
SystemOptions chain_in_common() {
  const auto sees = [](int camera, int point) {
    const int place = point * kCameras / kPoints;
    return camera >= place && camera < place + 8 * kWindow;
  };
  return {.cameras = kCameras, .points = kPoints, .camera_size = 6, .sees = sees, .dense = false};
}

std::shared_ptr<const ReducedStructure> structure_of(const RandomSystem& system) {
  return std::make_shared<ReducedStructure>(
      ReducedStructure{.pattern = make_global_camera_pattern(
                           system.graph, {}, system.normal().pool(), system.normal().exchange())});
}

CameraPartition shares_of(const RandomSystem& system, const CameraPattern& pattern) {
  return {system.normal(),
          group_cameras(system.normal(), &pattern, PreconditionerKind::kClusters).clusters,
          std::vector<double>(system.graph.num_cameras, 1.0)};
}

TEST(CameraPartition, AreAlikeInSizeAndWhereTheObservationsAre) {
  support::play_ranks(2, [&](Exchange& exchange) {
    const RandomSystem part(chain_in_halves(), exchange);
    const CameraPartition shares = shares_of(part, structure_of(part)->pattern);
    double own = 0.0, elsewhere = 0.0;
    for (int i = 0; i < kCameras; ++i) {
      own += shares.is_own(i);
      elsewhere += shares.is_own(i) && part.graph.observations_of_camera(i) == 0;
    }
    EXPECT_NEAR(own, kCameras / 2, 20);
    EXPECT_LT(elsewhere, 20);
    EXPECT_EQ(exchange.sum(own), kCameras);
  });
}

// All rows of S, in their whole pattern, zero where they are another rank's; and in how many rounds
// they were sent.
std::pair<std::vector<double>, int> rows_of(const RandomSystem& system) {
  const NormalEquations& normal = system.normal();
  PointElimination elimination(normal);
  elimination.factor({1e-3, DampingMatrix::kDiagonal});
  const auto structure = structure_of(system);
  const CameraPartition shares = shares_of(system, structure->pattern);
  DistributedSchurRows rows(normal, elimination, shares, structure);
  rows.begin();
  std::vector<std::vector<double>> numbers(kCameras);
  for (int round = 0; round < rows.num_rounds(); ++round) {
    rows.exchange(round);
    for (int i : rows.rows_of_round(round)) {
      const CameraPattern& whole = structure->pattern;
      std::vector<double>& row = numbers[i];
      row.resize(12 + 36 * (whole.row_begin[i + 1] - whole.row_begin[i]), 0.0);
      const SchurRows::Place place{row.data() + 12, row.data() + 48, row.data()};
      rows.form({&i, 1}, {&place, 1}, 0);
      for (int k = 0; k < 6; ++k) row[k] += std::exchange(row[6 + k], 0.0);
    }
  }
  std::vector<double> all;
  for (const std::vector<double>& row : numbers) all.insert(all.end(), row.begin(), row.end());
  return {all, rows.num_rounds()};
}

// The rows of all ranks are S, and of each what its own points make of them is a part.
void expect_rows_of_one_rank(const SystemOptions& options, int least_rounds) {
  const std::vector<double> whole = rows_of(RandomSystem(options)).first;
  for (int ranks : {2, 3}) {
    support::play_ranks(ranks, [&](Exchange& exchange) {
      auto [mine, rounds] = rows_of(RandomSystem(options, exchange));
      EXPECT_GE(rounds, least_rounds);
      exchange.sum(mine);
      ASSERT_EQ(mine.size(), whole.size());
      if (support::products_are_fused()) {
        EXPECT_EQ(mine, whole);
      }
      for (std::size_t k = 0; k < whole.size(); ++k) EXPECT_NEAR(mine[k], whole[k], 1e-9);
    });
  }
}

TEST(DistributedSchurRows, AreThoseOfOneRank) { expect_rows_of_one_rank(chain_in_halves(), 1); }

TEST(DistributedSchurRows, AreSentInRoundsWhereTheyAreMany) {
  expect_rows_of_one_rank(chain_in_common(), 2);
}

// Rank 0 has the first third of a long chain, rank 1 the last, and both have the middle.
SystemOptions chain_in_thirds() {
  const auto sees = [](int camera, int point) {
    const int place = (point % 2 + point / 2 % 2 + 1.0 * point / 2400) * 120;
    return camera >= place && camera < place + 64;
  };
  return {.cameras = 424, .points = 2400, .camera_size = 6, .sees = sees, .dense = false};
}

TEST(DistributedSchurRows, AreAlikeInWhatTheirRoundsReceive) {
  support::play_ranks(2, [&](Exchange& exchange) {
    const RandomSystem part(chain_in_thirds(), exchange);
    const PointElimination elimination(part.normal());
    const auto structure = structure_of(part);
    const CameraPartition shares = shares_of(part, structure->pattern);
    const DistributedSchurRows rows(part.normal(), elimination, shares, structure);
    ASSERT_GE(rows.num_rounds(), 4);
    long all = 0, most = 0;
    for (int round = 0; round < rows.num_rounds(); ++round) {
      all += rows.received_in_round(round);
      most = std::max(most, rows.received_in_round(round));
    }
    EXPECT_LE(most * rows.num_rounds(), 2.2 * all);
  });
}

TEST(ColumnPartition, SpreadAndCollectWhatIsTouchedAlone) {
  const SystemOptions options{.cameras = 12,
                              .points = 40,
                              .camera_size = 9,
                              .shared = 2,
                              .groups = 2,
                              .window = 3,
                              .dense = false};
  support::play_ranks(3, [&](Exchange& exchange) {
    const RandomSystem part(options, exchange);
    const CameraPartition shares = shares_of(part, structure_of(part)->pattern);
    std::vector<char> touched(12, 0);
    touched[exchange.rank()] = touched[11] = 1;
    ColumnPartition columns(part.normal(), shares, touched);
    const auto size = static_cast<std::size_t>(part.map.num_columns);
    Vector numbers(size), own, again, summed;
    for (std::size_t k = 0; k < size; ++k) numbers[k] = 1.0 + static_cast<double>(k);
    columns.take(numbers, own);
    const Vector& spread = columns.with_ghosts(own);
    Vector ones(size, 0.0);
    for (int i = 0; i < 12; ++i) {
      for (int k = 0; k < 9; ++k) {
        const int column = part.map.columns_of(i)[k];
        if (column == kNoColumn || !(touched[i] || columns.is_own(column))) continue;
        EXPECT_EQ(spread[column], numbers[column]);
        ones[column] = 1.0;
      }
    }
    Vector holders = ones;
    exchange.sum(holders);
    columns.sum_ghosts(ones, own);
    columns.gather(own, again);
    EXPECT_EQ(again, holders);
  });
}

}  // namespace
}  // namespace sfmcpp::linear::camera_shares_test

#include "sfmcpp/linear/parameter_map.hpp"

#include <algorithm>
#include <random>
#include <set>

#include <gtest/gtest.h>

#include "sfmcpp/linear/block_layout.hpp"
#include "support/random_system.hpp"

namespace sfmcpp::linear::parameter_map_test {
namespace {

std::vector<double> random_numbers(int count, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<double> numbers(count);
  for (double& x : numbers) x = normal(random);
  return numbers;
}

double dot(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) sum += a[k] * b[k];
  return sum;
}

ParameterMap map_with_shared_and_fixed() {
  return support::make_map(
      {.cameras = 7,
       .camera_size = 12,
       .padding = 2,
       .shared = 4,
       .groups = 3,
       .fixed_cameras = {2},
       .fixed_columns = {{0, 0}, {0, 1}, {0, 2}, {0, 3}, {0, 4}, {0, 5}, {1, 4}}});
}

TEST(ParameterMap, SharedColumnsAreThoseOfSeveralCameras) {
  const ParameterMap map = map_with_shared_and_fixed();
  std::vector<int> cameras(map.num_columns, 0);
  for (int column : map.column) {
    if (column != kNoColumn) ++cameras[column];
  }
  const std::vector<char> shared = shared_columns(map);
  for (int k = 0; k < map.num_columns; ++k) EXPECT_EQ(shared[k] != 0, cameras[k] > 1) << k;
  EXPECT_NE(std::count(shared.begin(), shared.end(), 1), 0);
}

TEST(ParameterMap, PosesFirstHasEveryColumnInItsBlockAndEveryPoseBeforeTheIntrinsics) {
  const ParameterMap map = map_with_shared_and_fixed();
  const PosesFirst ordered = poses_first(map);
  const std::set<int> places(ordered.place.begin(), ordered.place.end());
  EXPECT_EQ(std::ssize(places), map.num_columns);
  EXPECT_EQ(*places.rbegin(), map.num_columns - 1);
  for (int k = 0; k < map.num_columns; ++k) {
    const int place = ordered.place[k];
    EXPECT_EQ(map.is_intrinsic[k] == 0, place < ordered.num_poses) << k;
    EXPECT_EQ(ordered.map.is_intrinsic[place], map.is_intrinsic[k]) << k;
    const int block = ordered.map.block_of[place];
    EXPECT_LE(ordered.map.block_begin[block], place);
    EXPECT_LT(place, ordered.map.block_begin[block + 1]);
  }
  for (std::size_t k = 0; k < map.column.size(); ++k) {
    const int column = map.column[k];
    EXPECT_EQ(ordered.map.column[k], column == kNoColumn ? kNoColumn : ordered.place[column]);
  }
  // A block of the new order is a part of one of the old.
  for (int k = 0; k < map.num_columns; ++k) {
    for (int l = 0; l < map.num_columns; ++l) {
      const bool together =
          map.block_of[k] == map.block_of[l] && map.is_intrinsic[k] == map.is_intrinsic[l];
      EXPECT_EQ(ordered.map.block_of[ordered.place[k]] == ordered.map.block_of[ordered.place[l]],
                together);
    }
  }
}

// ⟨P x, y⟩ = ⟨x, Pᵀ y⟩ over all cameras.
TEST(ParameterMap, ExpandAndFoldAreAdjoint) {
  const ParameterMap map = map_with_shared_and_fixed();
  const std::vector<double> x = random_numbers(map.num_columns, 1);
  const int size = map.camera_size;
  std::vector<double> y = random_numbers(7 * size, 2), expanded(7 * size),
                      folded(map.num_columns, 0.0);
  for (int i = 0; i < 7; ++i) {
    map.expand(x.data(), i, expanded.data() + i * size);
    map.fold(y.data() + i * size, i, folded.data());
  }
  EXPECT_NEAR(dot(expanded, y), dot(x, folded), 1e-12);
}

TEST(ParameterMap, ExpandCopiesWhereThereIsAColumnAndIsZeroElsewhere) {
  const ParameterMap map = map_with_shared_and_fixed();
  const std::vector<double> x = random_numbers(map.num_columns, 3);
  std::vector<double> block(map.camera_size);
  for (int i = 0; i < 7; ++i) {
    map.expand(x.data(), i, block.data());
    for (int k = 0; k < map.camera_size; ++k) {
      const int column = map.columns_of(i)[k];
      EXPECT_EQ(block[k], column == kNoColumn ? 0.0 : x[column]);
    }
  }
}

TEST(ParameterMap, BlocksCutTheReducedColumnsWithoutGap) {
  const ParameterMap map = map_with_shared_and_fixed();
  ASSERT_EQ(map.block_begin.front(), 0);
  ASSERT_EQ(map.block_begin.back(), map.num_columns);
  for (int b = 0; b < map.num_blocks(); ++b) {
    EXPECT_LT(map.block_begin[b], map.block_begin[b + 1]);
    for (int c = map.block_begin[b]; c < map.block_begin[b + 1]; ++c) EXPECT_EQ(map.block_of[c], b);
  }
}

TEST(PaddedCameraSize, IsTheNextSizeThatKernelsAreCompiledFor) {
  const std::set<int> compiled{6, 9, 12, 18};
  for (int free = 6; free <= 18; ++free)
    EXPECT_EQ(padded_camera_size(free), *compiled.lower_bound(free));
}

TEST(PanelIndex, NumbersTheEntriesOfABlockOneToOne) {
  for (int size : {6, 9, 12, 18}) {
    std::set<int> places;
    for (int row = 0; row < size; ++row) {
      for (int column = 0; column < size; ++column) places.insert(panel_index(size, row, column));
    }
    EXPECT_EQ(static_cast<int>(places.size()), size * size);
    EXPECT_EQ(*places.begin(), 0);
    EXPECT_EQ(*places.rbegin(), size * size - 1);
  }
}

TEST(PanelIndex, ColumnsOfAPanelAreContiguous) {
  for (int size : {6, 9, 12, 18}) {
    for (int first = 0; first < size; first += panel_width(size - first)) {
      for (int row = first + 1; row < first + panel_width(size - first); ++row) {
        EXPECT_EQ(panel_index(size, row, 2), panel_index(size, row - 1, 2) + 1);
      }
    }
  }
}

}  // namespace
}  // namespace sfmcpp::linear::parameter_map_test

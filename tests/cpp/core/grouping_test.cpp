#include "sfmcpp/core/grouping.hpp"

#include <vector>

#include <gtest/gtest.h>

namespace sfmcpp::group_ranks_test {
namespace {

TEST(GroupRanks, EachElementCountsThoseOfItsGroupBeforeIt) {
  const std::vector<std::int32_t> group{2, 0, 2, 2, 0};
  std::vector<long> ranks(group.size());
  ASSERT_TRUE(group_ranks(group, 3, ranks.data()));
  EXPECT_EQ(ranks, (std::vector<long>{0, 0, 1, 2, 1}));
  EXPECT_FALSE(group_ranks(group, 2, ranks.data()));
  EXPECT_FALSE(group_ranks(std::vector<std::int32_t>{-1}, 2, ranks.data()));
}

}  // namespace
}  // namespace sfmcpp::group_ranks_test

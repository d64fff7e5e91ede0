#include "sfmcpp/core/records.hpp"

#include <cstdint>
#include <cstring>
#include <string>

#include <gtest/gtest.h>

namespace sfmcpp::records_test {
namespace {

constexpr RecordLayout kLayout{11, 3};

std::string record(const std::string& name, std::uint64_t count, const std::string& items) {
  std::string head = name;
  for (int byte = 0; byte < 8; ++byte) head += static_cast<char>(count >> (8 * byte));
  return head + items;
}

TEST(Records, ApartAndJoinedAreTheSameBytes) {
  const std::string data =
      record("one", 2, "aaabbb") + record("two", 0, "") + record("six", 1, "ccc");
  const Records records = find_records(data, 3, kLayout);
  ASSERT_EQ(records.begin, (std::vector<long>{0, 17, 28}));
  ASSERT_EQ(records.end, static_cast<long>(data.size()));
  std::string heads(33, ' '), items(9, ' '), again(data.size(), ' ');
  split_records(data, records, kLayout, heads.data(), items.data());
  EXPECT_EQ(items, "aaabbbccc");
  ASSERT_TRUE(counts_fit(heads, items, kLayout));
  join_records(heads, items, kLayout, again.data());
  EXPECT_EQ(again, data);
}

TEST(Records, CountsThatTheDataBelieAreNotBelieved) {
  for (const std::uint64_t count : {std::uint64_t{3}, std::uint64_t{1} << 62, ~std::uint64_t{0}}) {
    const std::string data = record("one", 1, "aaa") + record("two", count, "bbbccc");
    const Records records = find_records(data, 2, kLayout);
    EXPECT_EQ(records.begin.size(), 1u);
    EXPECT_EQ(records.end, 14);
    EXPECT_FALSE(counts_fit(record("two", count, ""), "bbbccc", kLayout));
  }
  EXPECT_EQ(find_records(record("one", 0, ""), 9, kLayout).begin.size(), 1u);
  EXPECT_EQ(find_records("short", 1, kLayout).begin.size(), 0u);
}

}  // namespace
}  // namespace sfmcpp::records_test

// Records of a binary file: each a head of a fixed size that ends with a count (8 bytes,
// little-endian), then that many items of a fixed size. Only the record before determines where the
// next one is.
#pragma once

#include <string_view>
#include <vector>

namespace sfmcpp {

inline constexpr long kCountBytes = 8;  // of the count at the end of a head

// A head has at least kCountBytes, an item at least one byte.
struct RecordLayout {
  long head_bytes, item_bytes;
};

// Where the records begin, and where the last one ends. Fewer than `count` if the data end too
// early: then `end` is where the record begins that does not fit.
struct Records {
  std::vector<long> begin;
  long end = 0;
};
Records find_records(std::string_view data, long count, RecordLayout layout);

// The heads one after another, and the items one after another.
void split_records(
    std::string_view data, const Records& records, RecordLayout layout, char* heads, char* items);

// What split_records takes apart; the counts in the heads tell how many items each has, and are in
// all as many as there are.
void join_records(std::string_view heads, std::string_view items, RecordLayout layout, char* data);
// Whether they are.
bool counts_fit(std::string_view heads, std::string_view items, RecordLayout layout);

}  // namespace sfmcpp

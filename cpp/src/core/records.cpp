#include "sfmcpp/core/records.hpp"

#include <algorithm>
#include <cstdint>

namespace sfmcpp {
namespace {

// The count at the end of the head that begins here.
std::uint64_t count_of(const char* head, RecordLayout layout) {
  std::uint64_t count = 0;
  for (int byte = kCountBytes; byte-- > 0;) {
    const auto digit = static_cast<unsigned char>(head[layout.head_bytes - kCountBytes + byte]);
    count = (count << 8) | digit;
  }
  return count;
}

}  // namespace

Records find_records(std::string_view data, long count, RecordLayout layout) {
  Records records;
  const auto size = static_cast<long>(data.size());
  for (long record = 0; record < count; ++record) {
    const long left = size - records.end - layout.head_bytes;
    if (left < 0) break;
    const std::uint64_t items = count_of(data.data() + records.end, layout);
    if (items > static_cast<std::uint64_t>(left / layout.item_bytes)) break;
    records.begin.push_back(records.end);
    records.end += layout.head_bytes + static_cast<long>(items) * layout.item_bytes;
  }
  return records;
}

void split_records(
    std::string_view data, const Records& records, RecordLayout layout, char* heads, char* items) {
  for (std::size_t record = 0; record < records.begin.size(); ++record) {
    const long next = record + 1 < records.begin.size() ? records.begin[record + 1] : records.end;
    const char* items_begin = data.data() + records.begin[record] + layout.head_bytes;
    heads = std::copy(items_begin - layout.head_bytes, items_begin, heads);
    items = std::copy(items_begin, data.data() + next, items);
  }
}

void join_records(std::string_view heads, std::string_view items, RecordLayout layout, char* data) {
  const char* item = items.data();
  for (const char* head = heads.data(); head < heads.data() + heads.size();) {
    const long bytes = static_cast<long>(count_of(head, layout)) * layout.item_bytes;
    data = std::copy(head, head + layout.head_bytes, data);
    data = std::copy(item, item + bytes, data);
    head += layout.head_bytes;
    item += bytes;
  }
}

bool counts_fit(std::string_view heads, std::string_view items, RecordLayout layout) {
  if (heads.size() % layout.head_bytes != 0 || items.size() % layout.item_bytes != 0) return false;
  std::uint64_t left = items.size() / layout.item_bytes;
  for (std::size_t head = 0; head < heads.size(); head += layout.head_bytes) {
    const std::uint64_t count = count_of(heads.data() + head, layout);
    if (count > left) return false;
    left -= count;
  }
  return left == 0;
}

}  // namespace sfmcpp

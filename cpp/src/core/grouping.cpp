#include "sfmcpp/core/grouping.hpp"

#include <vector>

namespace sfmcpp {

bool group_ranks(std::span<const std::int32_t> group, long num_groups, long* ranks) {
  std::vector<long> next(static_cast<std::size_t>(num_groups), 0);
  for (const std::int32_t g : group) {
    if (g < 0 || g >= num_groups) return false;
    *ranks++ = next[static_cast<std::size_t>(g)]++;
  }
  return true;
}

}  // namespace sfmcpp

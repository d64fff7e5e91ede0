// Elements in groups, as observations are of cameras or points.
#pragma once

#include <cstdint>
#include <span>

namespace sfmcpp {

// How many elements of the same group come before each one. Groups are in [0, num_groups).
// Returns whether all of them are.
bool group_ranks(std::span<const std::int32_t> group, long num_groups, long* ranks);

}  // namespace sfmcpp

#pragma once

#include <cstdint>

namespace sfmcpp::linear {

// Where a block lies in a matrix stored by columns: entry (r, c) at first + c · stride + r.
struct BlockPlace {
  std::int64_t first = 0;
  std::int64_t stride = 0;

  std::int64_t of(std::int64_t r, std::int64_t c) const { return first + c * stride + r; }
};

}  // namespace sfmcpp::linear

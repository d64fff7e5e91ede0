// How blocks of the Schur complement lie in memory.
//
// By itself a D×D block is kept in panels of 8, 4, 2 or 1 rows, each panel column by column, so
// that every vector register of a panel is one load (D = 9: a panel of 8 rows and one of 1).
#pragma once

#include <cstdint>
#include <vector>

namespace sfmcpp::linear {

constexpr int panel_width(int rows_left) {
  return rows_left >= 8 ? 8 : rows_left >= 4 ? 4 : rows_left >= 2 ? 2 : 1;
}

constexpr int panel_index(int size, int row, int column) {
  int first = 0;
  int width = panel_width(size);
  while (row >= first + width) {
    first += width;
    width = panel_width(size - first);
  }
  return first * size + column * width + (row - first);
}

// Where the entries of a block of `size` rows lie in its panels, row after row.
inline std::vector<int> panel_places(int size) {
  std::vector<int> places;
  for (int row = 0; row < size; ++row) {
    for (int column = 0; column < size; ++column) places.push_back(panel_index(size, row, column));
  }
  return places;
}

// A block within a stored matrix: entry (r, c) at first + c · stride + rows[r].
struct BlockPlace {
  std::int64_t first = 0;
  std::int64_t stride = 0;
  const std::int64_t* rows = nullptr;

  std::int64_t of(std::int64_t r, std::int64_t c) const { return first + c * stride + rows[r]; }
};

}  // namespace sfmcpp::linear

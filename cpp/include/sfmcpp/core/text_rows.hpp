// Rows of text from columns of numbers.
//
// A number gets the shortest text that reads back to the same bits. The rows are cut into tasks of
// a fixed size: the same text for every number of threads.
#pragma once

#include <span>
#include <string>
#include <variant>
#include <vector>

#include "sfmcpp/core/parallel.hpp"

namespace sfmcpp {

// Texts of at most `width` bytes each, filled up with NULs.
struct FixedTexts {
  const char* data;
  long width;
};

struct TextColumn {
  std::string before;  // what stands between the value before and this one
  std::variant<const double*, const long*, FixedTexts> values;
};

struct TextRow {
  std::vector<TextColumn> columns;
  std::string after;
};

// For each i the row i of `head`, then the next counts[i] rows of `item`, then `tail`. One text
// after another.
std::vector<std::string> ragged_rows(const TextRow& head,
                                     const TextRow& item,
                                     const std::string& tail,
                                     std::span<const long> counts,
                                     ThreadPool& pool);

}  // namespace sfmcpp

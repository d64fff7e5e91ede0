// Numbers as text: those that stand in one, apart by white space, and rows of text made of columns.
//
// The text is cut after line ends into pieces of a fixed size, so that each piece can be read by
// itself, on any thread, and knows its lines. Words are counted before they are read: the caller
// then knows how much memory the numbers take, and nothing that the text claims has to be believed.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "sfmcpp/core/parallel.hpp"

namespace sfmcpp {

class NumberText {
 public:
  // Lines that start with '#', after spaces or tabs, are passed over if there are `comments`.
  NumberText(std::string_view text, bool comments, ThreadPool& pool);

  long size() const { return first_word_.back(); }  // in words

  static constexpr long kAllGood = -1;
  // Writes size() numbers, each the double next to its decimal text. Returns the byte at which the
  // first word starts that is no finite number, or kAllGood.
  long read(double* values, ThreadPool& pool) const;

  // The lines that hold words, one after another: index of the first word, how many, and the number
  // of the line counted from 1.
  struct Lines {
    std::vector<long> first, count, number;
  };
  Lines lines(ThreadPool& pool) const;

 private:
  std::string_view text_;
  bool comments_;
  std::vector<std::string_view> pieces_;
  std::vector<long> first_word_;  // of each piece, and the end
};

// In a row a number gets the shortest text that reads back to the same bits. Rows are cut into
// tasks of a fixed size: the same text for every number of threads.

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

#include "sfmcpp/core/text_rows.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>

namespace sfmcpp {
namespace {

constexpr long kRowsOfATask = 4096;
constexpr long kLongestNumber = 32;  // a double takes 26 characters at most, an integer 20

struct Task {
  long head, item;  // where it begins
};

// Where each task begins, and the end of the last: a head is not parted from its items.
std::vector<Task> tasks_of(std::span<const long> counts) {
  std::vector<Task> tasks{{0, 0}};
  Task end{0, 0};
  long rows = 0;
  for (const long count : counts) {
    ++end.head;
    end.item += count;
    rows += 1 + count;
    if (rows >= kRowsOfATask) {
      tasks.push_back(end);
      rows = 0;
    }
  }
  if (rows > 0) tasks.push_back(end);
  return tasks;
}

long longest_row(const TextRow& row) {
  auto bytes = static_cast<long>(row.after.size());
  for (const TextColumn& column : row.columns) {
    const auto* texts = std::get_if<FixedTexts>(&column.values);
    bytes += static_cast<long>(column.before.size()) + (texts ? texts->width : kLongestNumber);
  }
  return bytes;
}

inline char* write(char* out, const std::string& text) {
  return std::copy(text.begin(), text.end(), out);
}

// Whole numbers get a ".0" that tells that they are no integers.
inline char* write_real(char* out, double value) {
  char* end = std::to_chars(out, out + kLongestNumber, value).ptr;
  const bool is_whole = value == std::trunc(value) && std::find(out, end, 'e') == end;
  return is_whole ? std::copy_n(".0", 2, end) : end;
}

inline char* write_value(char* out, const TextColumn& column, long row) {
  if (const auto* reals = std::get_if<const double*>(&column.values)) {
    return write_real(out, (*reals)[row]);
  }
  if (const auto* integers = std::get_if<const long*>(&column.values)) {
    return std::to_chars(out, out + kLongestNumber, (*integers)[row]).ptr;
  }
  const auto& texts = std::get<FixedTexts>(column.values);
  const char* text = texts.data + row * texts.width;
  return std::copy(text, std::find(text, text + texts.width, '\0'), out);
}

inline char* write_row(char* out, const TextRow& format, long row) {
  for (const TextColumn& column : format.columns) {
    out = write_value(write(out, column.before), column, row);
  }
  return write(out, format.after);
}

}  // namespace

std::vector<std::string> ragged_rows(const TextRow& head,
                                     const TextRow& item,
                                     const std::string& tail,
                                     std::span<const long> counts,
                                     ThreadPool& pool) {
  const std::vector<Task> tasks = tasks_of(counts);
  const long head_bytes = longest_row(head) + static_cast<long>(tail.size()),
             item_bytes = longest_row(item);
  std::vector<std::string> texts(tasks.size() - 1);
  pool.parallel_for(static_cast<int>(texts.size()), [&](int task) {
    const Task begin = tasks[task], end = tasks[task + 1];
    std::string& text = texts[task];
    text.resize(static_cast<std::size_t>((end.head - begin.head) * head_bytes +
                                         (end.item - begin.item) * item_bytes));
    char* out = text.data();
    long next = begin.item;
    for (long row = begin.head; row < end.head; ++row) {
      out = write_row(out, head, row);
      for (const long last = next + counts[row]; next < last; ++next) {
        out = write_row(out, item, next);
      }
      out = write(out, tail);
    }
    text.resize(static_cast<std::size_t>(out - text.data()));
  });
  return texts;
}

}  // namespace sfmcpp

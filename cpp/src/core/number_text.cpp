#include "sfmcpp/core/number_text.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <locale>
#include <sstream>
#include <string>

namespace sfmcpp {
namespace {

constexpr std::size_t kPieceBytes = std::size_t{1} << 17;

inline bool is_blank(char c) {
  return c == ' ' || static_cast<unsigned char>(c - '\t') <= '\r' - '\t';
}

// Just behind the end of the line in which `begin` stands.
inline const char* line_end(const char* begin, const char* end) {
  const void* newline = std::memchr(begin, '\n', static_cast<std::size_t>(end - begin));
  return newline == nullptr ? end : static_cast<const char*>(newline) + 1;
}

std::vector<std::string_view> pieces_of(std::string_view text) {
  std::vector<std::string_view> pieces;
  const char *begin = text.data(), *const end = begin + text.size();
  while (begin < end) {
    const auto left = static_cast<std::size_t>(end - begin);
    const char* next = left <= kPieceBytes ? end : line_end(begin + kPieceBytes - 1, end);
    pieces.emplace_back(begin, next - begin);
    begin = next;
  }
  return pieces;
}

bool is_comment(std::string_view line) {
  const std::size_t first = line.find_first_not_of(" \t");
  return first != std::string_view::npos && line[first] == '#';
}

template <class F>
void for_each_line(std::string_view piece, const F& f) {
  const char *begin = piece.data(), *const end = begin + piece.size();
  while (begin < end) {
    const char* next = line_end(begin, end);
    f(std::string_view(begin, static_cast<std::size_t>(next - begin)));
    begin = next;
  }
}

// Calls f with all text of the piece that is not in comments, in order.
template <class F>
void for_each_stretch(std::string_view piece, bool comments, const F& f) {
  if (!comments || piece.find('#') == std::string_view::npos) {
    f(piece);
  } else {
    for_each_line(piece, [&](std::string_view line) {
      if (!is_comment(line)) f(line);
    });
  }
}

// No branches: the compiler makes vectors of it.
long count_words(std::string_view text) {
  if (text.empty()) return 0;
  long count = is_blank(text[0]) ? 0 : 1;
  constexpr std::size_t kBlock = 255;  // counts of one byte do not overflow in it
  for (std::size_t begin = 1; begin < text.size(); begin += kBlock) {
    const std::size_t end = std::min(begin + kBlock, text.size());
    unsigned char starts = 0;
    for (std::size_t i = begin; i < end; ++i) {
      starts = static_cast<unsigned char>(starts + (static_cast<int>(is_blank(text[i - 1])) &
                                                    static_cast<int>(!is_blank(text[i]))));
    }
    count += starts;
  }
  return count;
}

// std::from_chars does not distinguish numbers that are too large for a double from those that are
// too small.
double out_of_range(const char* begin, const char* end) {
  std::istringstream stream(std::string(begin, end));
  stream.imbue(std::locale::classic());
  double value = 0.0;
  stream >> value;
  return stream ? value : std::numeric_limits<double>::infinity();
}

#ifdef __cpp_lib_to_chars
using std::from_chars;
#else
// Clang's library reads no floating-point numbers before version 20. Nothing hexadecimal, as above.
std::from_chars_result from_chars(const char* begin, const char* end, double& value) {
  static const locale_t kClassic = newlocale(LC_ALL_MASK, "C", nullptr);
  const auto is_end = [](char c) { return is_blank(c) || c == 'x' || c == 'X'; };
  const std::string word(begin, std::find_if(begin, end, is_end));
  char* next = nullptr;
  value = strtod_l(word.c_str(), &next, kClassic);
  const bool is_none = next == word.c_str() || word[0] == '+';
  return {is_none ? begin : begin + (next - word.c_str()),
          is_none ? std::errc::invalid_argument : std::errc()};
}
#endif

// The number whose text starts at `begin`; returns where its text ends, or `begin` if there is
// none.
inline const char* read_number(const char* begin, const char* end, double& value) {
  const bool plus = *begin == '+' && end - begin > 1 && begin[1] != '-';
  const auto [next, error] = from_chars(begin + (plus ? 1 : 0), end, value);
  if (error == std::errc::result_out_of_range) value = out_of_range(begin, next);
  return error == std::errc::invalid_argument ? begin : next;
}

// Reads the numbers of a stretch to `values` and beyond; returns the first word that is none.
const char* read_stretch(std::string_view stretch, double*& values) {
  const char *at = stretch.data(), *const end = at + stretch.size();
  for (;;) {
    while (at < end && is_blank(*at)) ++at;
    if (at == end) return nullptr;
    const char* next = read_number(at, end, *values);
    if (next == at || (next < end && !is_blank(*next)) || !std::isfinite(*values)) return at;
    ++values;
    at = next;
  }
}

NumberText::Lines lines_of(std::string_view piece, bool comments) {
  NumberText::Lines lines;
  long word = 0, number = 0;
  for_each_line(piece, [&](std::string_view line) {
    ++number;
    const long count = comments && is_comment(line) ? 0 : count_words(line);
    if (count == 0) return;
    lines.first.push_back(word);
    lines.count.push_back(count);
    lines.number.push_back(number);
    word += count;
  });
  return lines;
}

}  // namespace

NumberText::NumberText(std::string_view text, bool comments, ThreadPool& pool)
    : text_(text), comments_(comments), pieces_(pieces_of(text)), first_word_(pieces_.size() + 1) {
  pool.parallel_for(static_cast<int>(pieces_.size()), [&](int piece) {
    long count = 0;
    for_each_stretch(
        pieces_[piece], comments_, [&](std::string_view s) { count += count_words(s); });
    first_word_[piece + 1] = count;
  });
  for (std::size_t piece = 0; piece < pieces_.size(); ++piece) {
    first_word_[piece + 1] += first_word_[piece];
  }
}

long NumberText::read(double* values, ThreadPool& pool) const {
  std::vector<const char*> bad(pieces_.size(), nullptr);
  pool.parallel_for(static_cast<int>(pieces_.size()), [&](int piece) {
    double* next = values + first_word_[piece];
    for_each_stretch(pieces_[piece], comments_, [&](std::string_view s) {
      if (bad[piece] == nullptr) bad[piece] = read_stretch(s, next);
    });
  });
  for (const char* word : bad) {
    if (word != nullptr) return word - text_.data();
  }
  return kAllGood;
}

NumberText::Lines NumberText::lines(ThreadPool& pool) const {
  std::vector<Lines> parts(pieces_.size());
  std::vector<long> breaks(pieces_.size());
  pool.parallel_for(static_cast<int>(pieces_.size()), [&](int piece) {
    parts[piece] = lines_of(pieces_[piece], comments_);
    breaks[piece] = std::count(pieces_[piece].begin(), pieces_[piece].end(), '\n');
  });
  Lines all;
  long before = 0;
  for (std::size_t piece = 0; piece < parts.size(); ++piece) {
    const Lines& part = parts[piece];
    for (std::size_t i = 0; i < part.first.size(); ++i) {
      all.first.push_back(first_word_[piece] + part.first[i]);
      all.count.push_back(part.count[i]);
      all.number.push_back(before + part.number[i]);
    }
    before += breaks[piece];
  }
  return all;
}

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

// Whole numbers get a ".0", so that they are not read as integers.
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

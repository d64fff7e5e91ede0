#include "sfmcpp/core/number_text.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
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

// std::from_chars does not tell what is too large for a double from what is too small.
double out_of_range(const char* begin, const char* end) {
  std::istringstream stream(std::string(begin, end));
  stream.imbue(std::locale::classic());
  double value = 0.0;
  stream >> value;
  return stream ? value : std::numeric_limits<double>::infinity();
}

// The number whose text starts at `begin`; returns where its text ends, or `begin` if there is
// none.
inline const char* read_number(const char* begin, const char* end, double& value) {
  const bool plus = *begin == '+' && end - begin > 1 && begin[1] != '-';
  const auto [next, error] = std::from_chars(begin + (plus ? 1 : 0), end, value);
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

}  // namespace sfmcpp

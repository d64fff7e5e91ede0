#include "sfmcpp/core/number_text.hpp"

#include <bit>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <random>
#include <string>

#include <gtest/gtest.h>

namespace sfmcpp::number_text_test {
namespace {

std::vector<double> numbers_of(const NumberText& text, ThreadPool& pool) {
  std::vector<double> values(static_cast<std::size_t>(text.size()));
  EXPECT_EQ(text.read(values.data(), pool), NumberText::kAllGood);
  return values;
}

long first_bad(const std::string& data, bool comments = false) {
  ThreadPool pool(1);
  const NumberText text(data, comments, pool);
  std::vector<double> values(static_cast<std::size_t>(text.size()));
  return text.read(values.data(), pool);
}

// Doubles of all magnitudes, whole ones and subnormal ones among them.
std::vector<double> random_doubles(int count) {
  std::mt19937_64 bits(3);
  std::vector<double> values{0.0, -0.0, 1.0, 1e22, 5e-324, std::numeric_limits<double>::max()};
  while (static_cast<int>(values.size()) < count) {
    const auto value = std::bit_cast<double>(bits());
    if (std::isfinite(value)) values.push_back(value);
    values.push_back(std::ldexp(static_cast<double>(bits() >> 40), -10));
  }
  return values;
}

std::string joined(const std::vector<std::string>& texts) {
  std::string all;
  for (const std::string& text : texts) all += text;
  return all;
}

std::string rows_of(const std::vector<double>& values, int threads) {
  ThreadPool pool(threads);
  const std::vector<long> no_items(values.size(), 0);
  return joined(ragged_rows({{{"", values.data()}}, "\n"}, {}, "", no_items, pool));
}

TEST(NumberText, WhatIsWrittenReadsBackToTheSameBits) {
  const std::vector<double> values = random_doubles(60000);
  const std::string text = rows_of(values, 2);
  ThreadPool pool(2);
  const std::vector<double> back = numbers_of({text, false, pool}, pool);
  ASSERT_EQ(back.size(), values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    ASSERT_EQ(std::bit_cast<std::uint64_t>(back[i]), std::bit_cast<std::uint64_t>(values[i]));
  }
}

TEST(NumberText, NumbersAreThoseOfStrtod) {
  std::mt19937 bits(5);
  std::string text;
  std::vector<double> expected;
  for (int i = 0; i < 20000; ++i) {
    std::string word =
        std::to_string(bits() % 2 ? static_cast<long>(bits()) : -static_cast<long>(bits()));
    if (bits() % 2) word.append(1, '.').append(std::to_string(bits()));
    if (bits() % 2)
      word.append(1, 'e').append(std::to_string(static_cast<int>(bits() % 700) - 350));
    const double value = std::strtod(word.c_str(), nullptr);
    if (!std::isfinite(value)) continue;
    expected.push_back(value);
    text += word + (bits() % 2 ? " \r\n" : "\t");
  }
  ThreadPool pool(1);
  EXPECT_EQ(numbers_of({text, false, pool}, pool), expected);
}

TEST(NumberText, ThreadsDoNotChangeNumbersLinesOrText) {
  const std::vector<double> values = random_doubles(90000);
  const std::string text = rows_of(values, 1);
  ThreadPool one(1);
  const NumberText reference(text, true, one);
  for (int threads : {2, 3}) {
    ThreadPool pool(threads);
    const NumberText other(text, true, pool);
    EXPECT_EQ(numbers_of(other, pool), numbers_of(reference, one));
    EXPECT_EQ(other.lines(pool).number, reference.lines(one).number);
    EXPECT_EQ(rows_of(values, threads), text);
  }
}

TEST(NumberText, LinesKnowTheirWordsAcrossPieces) {
  std::string text = "# head\n\n";
  constexpr long kLines = 50000;
  for (long i = 0; i < kLines; ++i)
    text += i % 3 == 0 ? "1 2 3\n" : i % 3 == 1 ? " \t# 7 x\n" : "-4\n";
  ThreadPool pool(2);
  const NumberText::Lines lines = NumberText(text, true, pool).lines(pool);
  long word = 0, row = 0;
  for (long i = 0; i < kLines; ++i) {
    if (i % 3 == 1) continue;
    const long count = i % 3 == 0 ? 3 : 1;
    ASSERT_EQ(lines.number[row], i + 3);
    ASSERT_EQ(lines.first[row], word);
    ASSERT_EQ(lines.count[row], count);
    word += count;
    ++row;
  }
  EXPECT_EQ(row, static_cast<long>(lines.first.size()));
}

TEST(NumberText, TheFirstWordThatIsNoFiniteNumberIsFound) {
  const std::string many(400000, '\n');
  for (const char* word :
       {"x", "1_0", "1-2", "0x10", "+-5", "++5", "+", "1e", ".", "nan", "-inf", "1e999", "#"}) {
    EXPECT_EQ(first_bad("1 2\n" + many + word + " 3 y"), 4 + static_cast<long>(many.size()))
        << word;
  }
  for (const char* word : {"+5", "5.", ".5", "1E5", "1e-999", "-0", "00012"}) {
    EXPECT_EQ(first_bad(word), NumberText::kAllGood) << word;
  }
  EXPECT_EQ(first_bad("1\n # x\n2", true), NumberText::kAllGood);
  EXPECT_EQ(first_bad("1\n 2 # x\n", true), 5);
}

TEST(TextRows, ItemsStandBehindTheirHeads) {
  const std::vector<double> heads{1.0, 0.5, -2e30};
  const std::vector<long> items{7, 8, -9}, counts{2, 0, 1};
  const std::string names("ab\0c\0\0de\0", 9);
  ThreadPool pool(2);
  const TextRow head{{{"", heads.data()}, {" ", FixedTexts{names.data(), 3}}}, ":"};
  const TextRow item{{{" ", items.data()}}, ";"};
  EXPECT_EQ(joined(ragged_rows(head, item, "\n", counts, pool)),
            "1.0 ab: 7; 8;\n0.5 c:\n-2e+30 de: -9;\n");
}

}  // namespace
}  // namespace sfmcpp::number_text_test

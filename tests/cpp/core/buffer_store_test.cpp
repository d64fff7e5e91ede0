#include "sfmcpp/core/buffer_store.hpp"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#if defined(__linux__)
#include <sys/mman.h>
#endif

#include <gtest/gtest.h>

#include "sfmcpp/core/aligned.hpp"

namespace sfmcpp::buffer_store_test {
namespace {

constexpr std::size_t kSize = std::size_t{4} << 20;

struct Array {
  unsigned char* begin;
  std::size_t bytes;
  unsigned char mark;
};

bool holds_its_mark(const Array& array) {
  for (std::size_t k = 0; k < array.bytes; ++k) {
    if (array.begin[k] != array.mark) return false;
  }
  return true;
}

class Store : public testing::Test {
 protected:
  void SetUp() override {
    void* any = store.allocate(1);
    if (any == nullptr) GTEST_SKIP() << "this system reserves no memory";
    store.take_back(any, 1);
  }
  BufferStore store{kSize};
};

TEST_F(Store, ArraysNeverOverlapWhateverTheOrderTheyComeAndGoIn) {
  std::mt19937 random(3);
  std::vector<Array> live;
  for (int step = 0; step < 3000; ++step) {
    if (!live.empty() && random() % 2 == 0) {
      std::swap(live[random() % live.size()], live.back());
      ASSERT_TRUE(holds_its_mark(live.back()));
      ASSERT_TRUE(store.take_back(live.back().begin, live.back().bytes));
      live.pop_back();
    } else if (void* memory = nullptr; const std::size_t bytes = random() % 60000) {
      if ((memory = store.allocate(bytes)) == nullptr) continue;
      ASSERT_EQ(reinterpret_cast<std::size_t>(memory) % kCacheLine, 0u);
      const auto mark = static_cast<unsigned char>(step);
      std::memset(memory, mark, bytes);
      live.push_back({static_cast<unsigned char*>(memory), bytes, mark});
    }
  }
}

#if defined(MADV_POPULATE_WRITE)
TEST_F(Store, PagesMadeAheadAreThereAndKeepWhatArraysHold) {
  constexpr std::size_t kPage = 4096, kBytes = 64 * kPage;
  EXPECT_LE(store.touched(), kCacheLine);
  Array array{static_cast<unsigned char*>(store.allocate(kBytes)), kBytes, 7};
  EXPECT_EQ(store.touched(), kBytes);
  std::memset(array.begin, array.mark, kPage);
  std::vector<unsigned char> is_there(kBytes / kPage);
  const auto count = [&] {
    EXPECT_EQ(mincore(array.begin, kBytes, is_there.data()), 0);
    return std::ranges::count_if(is_there, [](unsigned char there) { return (there & 1) != 0; });
  };
  ASSERT_EQ(count(), 1);
  store.populate(0, kBytes / 2);
  if (count() == 1) GTEST_SKIP() << "this system makes no pages ahead";
  EXPECT_EQ(count(), 32);
  std::memset(array.begin + kPage, array.mark, kBytes - kPage);
  store.populate(0, kBytes);
  EXPECT_TRUE(holds_its_mark(array));
  store.populate(kSize - kPage, kSize + 5 * kPage);  // as far as the store goes
}
#endif

#if defined(MADV_HUGEPAGE)
// The system's flags of the memory that an address lies in; empty where it does not tell.
std::string flags_of(const char* address) {
  std::ifstream maps("/proc/self/smaps");
  bool is_of_address = false;
  for (std::string line; std::getline(maps, line);) {
    std::istringstream words(line);
    std::uintptr_t begin = 0, end = 0;
    char dash = 0;
    if (words >> std::hex >> begin >> dash >> end && dash == '-') {
      const auto wanted = reinterpret_cast<std::uintptr_t>(address);
      is_of_address = begin <= wanted && wanted < end;
    } else if (is_of_address && line.starts_with("VmFlags:")) {
      return line + " ";
    }
  }
  return "";
}

TEST(AllocateLarge, OnlyArraysOfAGigabyteAskForHugePages) {
  for (const std::size_t megabytes : {std::size_t{900}, std::size_t{1100}}) {
    const std::size_t bytes = megabytes << 20;
    void* memory = allocate_large(bytes);  // and never touched
    const std::string flags = flags_of(static_cast<char*>(memory) + bytes / 2);
    free_large(memory, bytes);
    if (flags.empty()) GTEST_SKIP() << "this system tells no flags of its memory";
    EXPECT_EQ(flags.find(" hg ") != std::string::npos, megabytes > 1024) << flags;
  }
}
#endif

TEST_F(Store, WhatIsGivenBackIsWholeAgain) {
  std::vector<void*> arrays;
  for (int k = 0; k < 64; ++k) arrays.push_back(store.allocate(kSize / 64));
  EXPECT_EQ(std::count(arrays.begin(), arrays.end(), nullptr), 0);
  EXPECT_EQ(store.allocate(1), nullptr);
  for (int k : {1, 0}) {  // every second one, then those between
    for (std::size_t i = k; i < arrays.size(); i += 2) store.take_back(arrays[i], kSize / 64);
  }
  EXPECT_EQ(store.allocate(kSize), arrays[0]);
}

TEST_F(Store, MemoryOfOthersIsNotItsOwn) {
  std::vector<char> other(100);
  EXPECT_FALSE(store.take_back(other.data(), other.size()));
}

TEST_F(Store, ManySmallArraysAreRefusedBeforeTheirGapsCouldBeForgotten) {
  std::vector<void*> arrays;
  while (void* memory = store.allocate(1)) arrays.push_back(memory);
  EXPECT_GT(arrays.size(), 500u);
  for (std::size_t k = 0; k < arrays.size(); k += 2) store.take_back(arrays[k], 1);
  for (std::size_t k = 1; k < arrays.size(); k += 2) store.take_back(arrays[k], 1);
  EXPECT_NE(store.allocate(kSize), nullptr);
}

TEST(AlignedVector, LivesInTheStoreOrOutsideIt) {
  for (const std::size_t size : {std::size_t{1}, std::size_t{1} << 16, std::size_t{1} << 24}) {
    AlignedVector<double> values(size, 2.0);
    EXPECT_EQ(reinterpret_cast<std::size_t>(values.data()) % kCacheLine, 0u);
    EXPECT_EQ(values.back(), 2.0);
  }
}

}  // namespace
}  // namespace sfmcpp::buffer_store_test

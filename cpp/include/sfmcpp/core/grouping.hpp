// Sets of numbers, by union–find.
#pragma once

#include <cstdint>
#include <numeric>
#include <span>
#include <vector>

namespace sfmcpp {

class DisjointSets {
 public:
  // Each of the numbers below `count` by itself.
  explicit DisjointSets(int count) : parent_(count), count_(count) {
    std::iota(parent_.begin(), parent_.end(), 0);
  }
  // The number that stands for the set of i.
  int root(int i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(int i, int j) {
    const int a = root(i), b = root(j);
    parent_[a] = b;
    count_ -= a != b;
  }
  int count() const { return count_; }

 private:
  std::vector<int> parent_;
  int count_;
};

// Elements in groups, as observations are of cameras or points.

// How many elements of the same group come before each one. Groups are in [0, num_groups).
// Returns whether all of them are.
bool group_ranks(std::span<const std::int32_t> group, long num_groups, long* ranks);

}  // namespace sfmcpp

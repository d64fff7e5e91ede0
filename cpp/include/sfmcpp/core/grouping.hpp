// Numbers in groups: sets that are joined, and the place of each element in its group.
#pragma once

#include <cstdint>
#include <numeric>
#include <span>
#include <vector>

namespace sfmcpp {

// By union–find, with paths halved as they are walked.
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
  // The root of j stands for both.
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

// How many elements of the same group come before each one: of the observations of a camera, say.
// False where a group is not in [0, num_groups).
bool group_ranks(std::span<const std::int32_t> group, long num_groups, long* ranks);

}  // namespace sfmcpp

// Memory for the arrays of solves, kept by the process.
//
// A solve lives for milliseconds, and all its arrays are as old as itself: taken from the system,
// every page of them would be cleared by it when it is touched first, 4 KB at a time, which costs a
// small problem as much as a step; and given back, they would have to be cleared again for the next
// solve. So arrays are cut from one piece of address space, and what they leave is kept for the
// next solve. The piece is bounded: what does not fit comes from the system. Huge pages are
// requested for arrays of a gigabyte only: virtual machines have to find them first, which took
// longer than smaller arrays save (docs/benchmarks.md, "cold starts").
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <mutex>

namespace sfmcpp {

class BufferStore {
 public:
  // All solves share this one; it has no room where the system has no such memory.
  static BufferStore& of_process();

  explicit BufferStore(std::size_t bytes);
  ~BufferStore();
  BufferStore(const BufferStore&) = delete;
  BufferStore& operator=(const BufferStore&) = delete;

  // Starts on a cache line; null where there is no room.
  void* allocate(std::size_t bytes);
  // False for memory that is not of this store.
  bool take_back(void* memory, std::size_t bytes);

  // So many bytes from the beginning have been part of an array: their pages are there.
  std::size_t touched() const { return touched_; }
  // Has the system make the pages of [begin, end) ahead of those who touch them; for a thread that
  // has nothing else to do.
  void populate(std::size_t begin, std::size_t end);
  std::size_t size() const { return size_; }

 private:
  // What is free, by address; neighbours are joined, so that there is at most one gap more than
  // arrays.
  struct Gap {
    char* begin;
    char* end;
  };
  static constexpr std::size_t kMaxGaps = 1024;

  Gap* gaps_end() { return gaps_.data() + num_gaps_; }
  void insert(Gap* place, const Gap& gap);
  void erase(Gap* place);

  char* begin_ = nullptr;
  std::size_t size_ = 0;
  std::size_t num_arrays_ = 0;
  std::atomic<std::size_t> touched_{0};
  std::array<Gap, kMaxGaps> gaps_;
  std::size_t num_gaps_ = 0;
  std::mutex mutex_;
};

}  // namespace sfmcpp

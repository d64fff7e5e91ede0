#include "sfmcpp/core/buffer_store.hpp"

#include <algorithm>
#include <cstdint>

#include "sfmcpp/core/aligned.hpp"

#if defined(__linux__)
#include <pthread.h>

#include <sys/mman.h>
#endif

namespace sfmcpp {
namespace {

// As much as the solves of some hundred thousand observations need, and as allocators keep too.
// Sanitizers are to see where every array ends and when it is freed.
#if defined(__linux__) && !defined(__SANITIZE_ADDRESS__)
constexpr std::size_t kKeptBytes = std::size_t{64} << 20;
#else
constexpr std::size_t kKeptBytes = 0;
#endif

// From here on huge pages pay: 100,000 cameras take 0.8 of the time, 10,000 with arrays of a tenth
// of this 1.1 to 1.5 times as long.
constexpr std::size_t kHugeBytes = std::size_t{1} << 30;

std::size_t rounded(std::size_t bytes, std::size_t multiple) {
  return (bytes + multiple - 1) / multiple * multiple;
}

// Address space; its pages are the system's until they are touched.
char* reserve(std::size_t bytes) {
#if defined(__linux__)
  void* memory = mmap(
      nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  return memory == MAP_FAILED ? nullptr : static_cast<char*>(memory);
#else
  static_cast<void>(bytes);
  return nullptr;
#endif
}

// Pages of 2 MB instead of 4 KB where the system has them; what is not whole pages stays as it is.
void ask_for_huge_pages(void* memory, std::size_t bytes) {
#if defined(MADV_HUGEPAGE)
  constexpr std::size_t kHugePage = std::size_t{2} << 20;
  const auto address = reinterpret_cast<std::uintptr_t>(memory);
  const std::size_t before = rounded(address, kHugePage) - address;
  const std::size_t whole = (bytes - before) / kHugePage * kHugePage;
  static_cast<void>(madvise(static_cast<char*>(memory) + before, whole, MADV_HUGEPAGE));
#else
  static_cast<void>(memory), static_cast<void>(bytes);
#endif
}

}  // namespace

BufferStore& BufferStore::of_process() {
  // Never destroyed: arrays may live until the process ends. A child that is forked while another
  // thread is in here finds the lock open.
  static BufferStore& store = [&]() -> BufferStore& {
    static auto* made = new BufferStore(kKeptBytes);
#if defined(__linux__)
    pthread_atfork(
        [] { made->mutex_.lock(); }, [] { made->mutex_.unlock(); }, [] { made->mutex_.unlock(); });
#endif
    return *made;
  }();
  return store;
}

BufferStore::BufferStore(std::size_t bytes) {
  if (bytes > 0) begin_ = reserve(bytes);
  if (begin_ == nullptr) return;
  size_ = bytes;
  insert(gaps_end(), {begin_, begin_ + size_});
}

BufferStore::~BufferStore() {
#if defined(__linux__)
  if (begin_ != nullptr) munmap(begin_, size_);
#endif
}

// The first gap that is large enough: what has been touched is used again first.
void* BufferStore::allocate(std::size_t bytes) {
  if (size_ == 0) return nullptr;
  const std::size_t wanted = rounded(std::max<std::size_t>(bytes, 1), kCacheLine);
  const std::lock_guard lock(mutex_);
  if (num_arrays_ + 1 == kMaxGaps) return nullptr;
  Gap* gap = std::find_if(gaps_.data(), gaps_end(), [&](const Gap& g) {
    return static_cast<std::size_t>(g.end - g.begin) >= wanted;
  });
  if (gap == gaps_end()) return nullptr;
  char* memory = gap->begin;
  gap->begin += wanted;
  if (gap->begin == gap->end) erase(gap);
  ++num_arrays_;
  touched_ = std::max<std::size_t>(touched_, memory + wanted - begin_);
  return memory;
}

bool BufferStore::take_back(void* memory, std::size_t bytes) {
  char* begin = static_cast<char*>(memory);
  if (size_ == 0 || begin < begin_ || begin >= begin_ + size_) return false;
  char* end = begin + rounded(std::max<std::size_t>(bytes, 1), kCacheLine);
  const std::lock_guard lock(mutex_);
  --num_arrays_;
  Gap* next = std::find_if(gaps_.data(), gaps_end(), [&](const Gap& g) { return g.begin >= end; });
  const bool joins_previous = next != gaps_.data() && next[-1].end == begin;
  const bool joins_next = next != gaps_end() && next->begin == end;
  if (joins_previous && joins_next) {
    next[-1].end = next->end;
    erase(next);
  } else if (joins_previous) {
    next[-1].end = end;
  } else if (joins_next) {
    next->begin = begin;
  } else {
    insert(next, {begin, end});
  }
  return true;
}

void BufferStore::populate(std::size_t begin, std::size_t end) {
#if defined(MADV_POPULATE_WRITE)
  constexpr std::size_t kPage = 4096;
  const std::size_t first = rounded(begin, kPage), last = std::min(end, size_) / kPage * kPage;
  if (first < last) static_cast<void>(madvise(begin_ + first, last - first, MADV_POPULATE_WRITE));
#else
  static_cast<void>(begin), static_cast<void>(end);
#endif
}

void BufferStore::insert(Gap* place, const Gap& gap) {
  std::move_backward(place, gaps_end(), gaps_end() + 1);
  *place = gap;
  ++num_gaps_;
}

void BufferStore::erase(Gap* place) {
  std::move(place + 1, gaps_end(), place);
  --num_gaps_;
}

void* allocate_large(std::size_t bytes) {
  if (void* kept = BufferStore::of_process().allocate(bytes)) return kept;
  void* memory = ::operator new (bytes, std::align_val_t{kCacheLine});
  if (bytes >= kHugeBytes) ask_for_huge_pages(memory, bytes);
  return memory;
}

void free_large(void* memory, std::size_t bytes) {
  if (!BufferStore::of_process().take_back(memory, bytes))
    ::operator delete (memory, std::align_val_t{kCacheLine});
}

}  // namespace sfmcpp

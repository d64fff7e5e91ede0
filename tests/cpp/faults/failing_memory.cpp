#include "faults/failing_memory.hpp"

#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <limits>
#include <new>

#include <sys/mman.h>

// The linker gives calls of f to __wrap_f, and those of __real_f to f.
extern "C" {
void* __real_malloc(std::size_t bytes);
void* __real_calloc(std::size_t count, std::size_t bytes);
void* __real_realloc(void* memory, std::size_t bytes);
void __real_free(void* memory);
void* __real_mmap(void* where, std::size_t bytes, int access, int flags, int file, off_t offset);
}

namespace sfmcpp::faults {
namespace {

constexpr long kNever = std::numeric_limits<long>::max();
std::atomic<long> left{kNever}, live{0};

bool fails() { return left.load() != kNever && left-- == 0; }

void* counted(void* memory) {
  if (memory != nullptr) ++live;
  return memory;
}

void* allocate(std::size_t bytes) { return fails() ? nullptr : counted(__real_malloc(bytes)); }

void release(void* memory) {
  if (memory == nullptr) return;
  --live;
  __real_free(memory);
}

void* or_throw(void* memory) {
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}

void* allocate_aligned(std::size_t bytes, std::align_val_t alignment) {
  const auto multiple = static_cast<std::size_t>(alignment);
  const std::size_t rounded = (bytes + multiple - 1) / multiple * multiple;
  return or_throw(fails() ? nullptr : counted(std::aligned_alloc(multiple, rounded)));
}

}  // namespace

FailingMemory::FailingMemory(long number) { left = number; }
FailingMemory::~FailingMemory() { left = kNever; }
bool FailingMemory::has_failed() const { return left < 0; }

long live_allocations() { return live; }

}  // namespace sfmcpp::faults

using namespace sfmcpp::faults;

extern "C" {

void* __wrap_malloc(std::size_t bytes) { return allocate(bytes); }
// What compilers make of malloc and zeros.
void* __wrap_calloc(std::size_t count, std::size_t bytes) {
  return fails() ? nullptr : counted(__real_calloc(count, bytes));
}
void __wrap_free(void* memory) { release(memory); }
void* __wrap_realloc(void* memory, std::size_t bytes) {
  if (fails()) return nullptr;
  void* moved = __real_realloc(memory, bytes);
  return memory == nullptr ? counted(moved) : moved;
}
void* __wrap_mmap(void* where, std::size_t bytes, int access, int flags, int file, off_t offset) {
  if (!fails()) return __real_mmap(where, bytes, access, flags, file, offset);
  errno = ENOMEM;
  return MAP_FAILED;
}
}

void* operator new(std::size_t bytes) { return or_throw(allocate(bytes)); }
void* operator new(std::size_t bytes, std::align_val_t alignment) {
  return allocate_aligned(bytes, alignment);
}
void operator delete(void* memory) noexcept { release(memory); }
void operator delete(void* memory, std::size_t) noexcept { release(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { release(memory); }
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept { release(memory); }

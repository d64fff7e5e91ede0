#include "sfmcpp/core/aligned.hpp"

#include "sfmcpp/core/buffer_store.hpp"

namespace sfmcpp {
namespace {

constexpr std::size_t kHugePage = std::size_t{1} << 21;

std::align_val_t alignment_for(std::size_t bytes) {
  return std::align_val_t{bytes >= kHugePage ? kHugePage : kCacheLine};
}

}  // namespace

void* allocate_large(std::size_t bytes) {
  if (void* kept = BufferStore::of_process().allocate(bytes)) return kept;
  void* memory = ::operator new(bytes, alignment_for(bytes));
  if (bytes >= kHugePage) wish_for_huge_pages(memory, bytes / kHugePage * kHugePage);
  return memory;
}

void free_large(void* memory, std::size_t bytes) {
  if (!BufferStore::of_process().take_back(memory, bytes))
    ::operator delete(memory, alignment_for(bytes));
}

}  // namespace sfmcpp

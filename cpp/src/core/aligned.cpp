#include "sfmcpp/core/aligned.hpp"

#include "sfmcpp/core/buffer_store.hpp"

namespace sfmcpp {

void* allocate_large(std::size_t bytes) {
  if (void* kept = BufferStore::of_process().allocate(bytes)) return kept;
  return ::operator new (bytes, std::align_val_t{kCacheLine});
}

void free_large(void* memory, std::size_t bytes) {
  if (!BufferStore::of_process().take_back(memory, bytes))
    ::operator delete (memory, std::align_val_t{kCacheLine});
}

}  // namespace sfmcpp

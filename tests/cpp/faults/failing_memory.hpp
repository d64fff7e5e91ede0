// Memory that runs out when a test says so. What the core asks for passes here: new in all its
// forms, malloc and its like (Eigen), mmap (core/buffer_store.hpp).
#pragma once

namespace sfmcpp::faults {

// While one lives, the allocation with that number (from 0, of any thread) fails, and no other.
class FailingMemory {
 public:
  explicit FailingMemory(long number);
  ~FailingMemory();
  FailingMemory(const FailingMemory&) = delete;
  FailingMemory& operator=(const FailingMemory&) = delete;

  // Were there so many allocations?
  bool has_failed() const;
};

// Allocations of this process that were not freed yet, address space aside.
long live_allocations();

}  // namespace sfmcpp::faults

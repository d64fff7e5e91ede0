// How often this program asks for memory.
#pragma once

namespace sfmcpp::bench {

// Calls of operator new so far; what core/buffer_store.hpp keeps is not asked for again.
long num_allocations();

}  // namespace sfmcpp::bench

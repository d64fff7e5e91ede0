// Instruction sets. The hot kernels (`*_kernels.cpp`) are compiled once per instruction set, in
// namespace `sfmcpp::…::SFMCPP_ISA`, and chosen when the program runs, so that one binary is fast
// on a new processor and still starts on an old one.
//
// Rule for such a file: it may only instantiate templates on Pack<SFMCPP_LANES> or in its own
// namespace. A shared inline function compiled with AVX-512 could be kept by the linker for
// everyone.
#pragma once

#include <string_view>

namespace sfmcpp {

enum class Isa { kBaseline, kAvx2, kAvx512 };

std::string_view isa_name(Isa isa);

// The best instruction set of this machine.
Isa best_isa();

// That, or the lower one that the environment variable SFMCPP_ISA (baseline, avx2, avx512) asks
// for. Read once. Throws InvalidArgument if it names none.
Isa active_isa();

// Kernels load whole packs: arrays of observations must be readable this far beyond their end.
inline constexpr int kReadAhead = 8;

}  // namespace sfmcpp

// Declares a function of the kernels for each instruction set, in a namespace of its own below the
// one in which this stands. Only SFMCPP_FOR_ACTIVE_ISA chooses among them.
#define SFMCPP_DECLARE_FOR_EACH_ISA(...) \
  namespace baseline {                   \
  __VA_ARGS__;                           \
  }                                      \
  namespace avx2 {                       \
  __VA_ARGS__;                           \
  }                                      \
  namespace avx512 {                     \
  __VA_ARGS__;                           \
  }

// The call of a function of the same name in the namespace of the active instruction set, each of
// them below the namespace in which this stands.
#if defined(__x86_64__)
#define SFMCPP_FOR_ACTIVE_ISA(call)                                \
  (::sfmcpp::active_isa() == ::sfmcpp::Isa::kAvx512 ? avx512::call \
   : ::sfmcpp::active_isa() == ::sfmcpp::Isa::kAvx2 ? avx2::call   \
                                                    : baseline::call)
#else
#define SFMCPP_FOR_ACTIVE_ISA(call) baseline::call
#endif

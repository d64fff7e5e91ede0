#include "sfmcpp/core/isa.hpp"

#include <algorithm>
#include <cstdlib>

namespace sfmcpp {
namespace {

Isa best_isa() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("x86-64-v4")) return Isa::kAvx512;
  if (__builtin_cpu_supports("x86-64-v3")) return Isa::kAvx2;
#endif
  return Isa::kBaseline;
}

Isa requested_isa() {
  const char* text = std::getenv("SFMCPP_ISA");
  for (Isa isa : {Isa::kBaseline, Isa::kAvx2}) {
    if (text != nullptr && isa_name(isa) == text) return isa;
  }
  return Isa::kAvx512;
}

}  // namespace

std::string_view isa_name(Isa isa) {
  switch (isa) {
    case Isa::kBaseline:
      return "baseline";
    case Isa::kAvx2:
      return "avx2";
    case Isa::kAvx512:
      return "avx512";
  }
  return "unknown";
}

Isa active_isa() {
  static const Isa isa = std::min(best_isa(), requested_isa());
  return isa;
}

}  // namespace sfmcpp

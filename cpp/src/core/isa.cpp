#include "sfmcpp/core/isa.hpp"

#include <algorithm>
#include <cstdlib>
#include <string>

#include "sfmcpp/core/error.hpp"

namespace sfmcpp {
namespace {

#if defined(__x86_64__)
#if defined(__clang__) ? __clang_major__ < 18 : __GNUC__ < 12
// Clang knows levels by name from version 18 on, GCC from 12 on. The features that older ones can
// name imply the others of the level: every processor with FMA and BMI2 also has F16C, LZCNT and
// MOVBE.
bool has_v3() {
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
         __builtin_cpu_supports("bmi2");
}
bool has_v4() {
  return has_v3() && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
         __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
         __builtin_cpu_supports("avx512vl");
}
#else
bool has_v3() { return __builtin_cpu_supports("x86-64-v3"); }
bool has_v4() { return __builtin_cpu_supports("x86-64-v4"); }
#endif
#endif

}  // namespace

Isa best_isa() {
#if defined(__x86_64__)
  if (has_v4()) return Isa::kAvx512;
  if (has_v3()) return Isa::kAvx2;
#endif
  return Isa::kBaseline;
}

namespace {

Isa requested_isa() {
  const char* text = std::getenv("SFMCPP_ISA");
  if (text == nullptr || *text == '\0') return Isa::kAvx512;
  for (Isa isa : {Isa::kBaseline, Isa::kAvx2, Isa::kAvx512}) {
    if (isa_name(isa) == text) return isa;
  }
  throw InvalidArgument("SFMCPP_ISA = '" + std::string(text) +
                        "': must be one of baseline, avx2, avx512");
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

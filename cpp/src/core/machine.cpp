#include "sfmcpp/core/machine.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <fstream>
#include <unistd.h>

namespace sfmcpp {
namespace {

// Of control groups, version 2 and 1; a group without a limit says "max", or a number beyond any
// memory.
constexpr const char* kLimits[] = {"/sys/fs/cgroup/memory.max",
                                   "/sys/fs/cgroup/memory/memory.limit_in_bytes"};

}  // namespace

double memory_limit_bytes() {
  double limit =
      static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGE_SIZE));
  for (const char* path : kLimits) {
    double bytes = 0.0;
    if (std::ifstream(path) >> bytes && bytes > 0.0) limit = std::min(limit, bytes);
  }
  return limit;
}

// FNV-1a, of which a double holds 52 bits.
double machine_number() {
  std::array<char, 256> name{};
  gethostname(name.data(), name.size() - 1);
  std::uint64_t hash = 0xcbf29ce484222325;
  for (const char* c = name.data(); *c != '\0'; ++c)
    hash = (hash ^ static_cast<unsigned char>(*c)) * 0x100000001b3;
  return static_cast<double>(hash >> 12);
}

}  // namespace sfmcpp

#include "sfmcpp/core/machine.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <limits>
#include <optional>
#include <string_view>
#include <thread>
#include <unistd.h>
#include <vector>

#if defined(__linux__)
#include <sched.h>
#endif

namespace sfmcpp {
namespace {

constexpr const char* kMountPoint = "/sys/fs/cgroup";

// Whether a list with commas has a word.
bool lists(std::string_view words, std::string_view wanted) {
  while (true) {
    const auto end = words.find(',');
    if (words.substr(0, end) == wanted) return true;
    if (end == std::string_view::npos) return false;
    words.remove_prefix(end + 1);
  }
}

// Where the group of this process is below the mount point, by a line "number:controllers:path" of
// /proc/self/cgroup. Version 2 of control groups names no controllers.
std::string path_of_group(std::string_view line, std::string_view controller) {
  const auto first = line.find(':'), second = line.find(':', first + 1);
  if (first == std::string_view::npos || second == std::string_view::npos) return {};
  const std::string_view names = line.substr(first + 1, second - first - 1);
  const std::string_view path = line.substr(second + 1);
  if (!path.starts_with('/')) return {};
  if (names.empty()) return std::string(path);
  if (!lists(names, controller)) return {};
  return std::string("/").append(controller).append(path);
}

// Folders of the groups of this process that may bound what a controller hands out, and of all that
// they are in: each bounds those inside. A container may see the own group as the mount point.
std::vector<std::string> group_folders(const std::string& root, const std::string& controller) {
  const std::string mounted = root + kMountPoint;
  std::vector<std::string> folders{mounted, mounted + "/" + controller};
  std::ifstream groups(root + "/proc/self/cgroup");
  for (std::string line; std::getline(groups, line);) {
    std::string path = path_of_group(line, controller);
    for (; path.size() > 1; path.erase(path.rfind('/'))) folders.push_back(mounted + path);
  }
  return folders;
}

// The number that a file begins with; a group without a limit says "max".
std::optional<double> number_in(const std::string& path) {
  double number = 0.0;
  if (std::ifstream(path) >> number && number > 0.0) return number;
  return std::nullopt;
}

// Seconds of processors that a group has in a second.
std::optional<double> processors_of(const std::string& folder) {
  double quota = 0.0, period = 0.0;
  if (std::ifstream(folder + "/cpu.max") >> quota >> period && quota > 0.0 && period > 0.0)
    return quota / period;
  const auto old_quota = number_in(folder + "/cpu.cfs_quota_us");
  const auto old_period = number_in(folder + "/cpu.cfs_period_us");
  if (old_quota && old_period) return *old_quota / *old_period;
  return std::nullopt;
}

// Cores that the scheduler may give to this process.
int bound_cores() {
#if defined(__linux__)
  constexpr std::size_t kMostCores = 1 << 16;
  for (std::size_t cores = CPU_SETSIZE; cores <= kMostCores; cores *= 2) {
    std::vector<cpu_set_t> set(cores / CPU_SETSIZE);
    const std::size_t bytes = set.size() * sizeof(cpu_set_t);
    if (sched_getaffinity(0, bytes, set.data()) == 0) return CPU_COUNT_S(bytes, set.data());
  }
#endif
  return static_cast<int>(std::thread::hardware_concurrency());
}

// Processors that the control groups have time for.
double granted_processors(const std::string& root) {
  double granted = std::numeric_limits<double>::infinity();
  for (const std::string& folder : group_folders(root, "cpu"))
    granted = std::min(granted, processors_of(folder).value_or(granted));
  return granted;
}

int usable(double granted) {
  return static_cast<int>(std::min<double>(std::max(1, bound_cores()), std::ceil(granted)));
}

}  // namespace

double memory_limit_bytes(const std::string& root) {
  double limit =
      static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGE_SIZE));
  for (const std::string& folder : group_folders(root, "memory")) {
    for (const char* name : {"/memory.max", "/memory.limit_in_bytes"})
      limit = std::min(limit, number_in(folder + name).value_or(limit));
  }
  return limit;
}

double memory_limit_bytes() {
  static const double limit = memory_limit_bytes("");
  return limit;
}

int usable_cores(const std::string& root) { return usable(granted_processors(root)); }

int usable_cores() {
  static const double granted = granted_processors("");
  return usable(granted);
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

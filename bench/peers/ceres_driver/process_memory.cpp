#include "process_memory.h"

#include <fstream>
#include <sstream>
#include <string>

namespace {

long StatusBytes(const std::string& key) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.rfind(key, 0) == 0) {
      long kilobytes = 0;
      std::istringstream(line.substr(key.size())) >> kilobytes;
      return kilobytes * 1024;
    }
  }
  return -1;
}

}  // namespace

long ResidentBytes() { return StatusBytes("VmRSS:"); }
long PeakResidentBytes() { return StatusBytes("VmHWM:"); }
void ResetPeak() { std::ofstream("/proc/self/clear_refs") << 5; }

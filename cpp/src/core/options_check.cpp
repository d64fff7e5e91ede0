#include "sfmcpp/core/options_check.hpp"

#include <cstdio>

#include "sfmcpp/core/error.hpp"

namespace sfmcpp {

void OptionsCheck::require(bool valid, const char* name, double value, const char* rule) {
  if (valid) return;
  char text[160];
  std::snprintf(text, sizeof text, "%s = %g: must be %s", name, value, rule);
  violations_ += (violations_.empty() ? "" : "; ") + std::string(text);
}

void OptionsCheck::done() const {
  if (!violations_.empty()) throw InvalidArgument(violations_);
}

}  // namespace sfmcpp

#pragma once

#include <string>

namespace sfmcpp {

// Collects every violation, then throws once.
class OptionsCheck {
 public:
  // Notes "name = value: must be rule" unless `valid`.
  void require(bool valid, const char* name, double value, const char* rule);
  // Throws InvalidArgument if anything was noted.
  void done() const;

 private:
  std::string violations_;
};

}  // namespace sfmcpp

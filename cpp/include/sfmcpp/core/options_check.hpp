// The checks of a set of numbers, all told at once.
#pragma once

#include <string>

namespace sfmcpp {

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

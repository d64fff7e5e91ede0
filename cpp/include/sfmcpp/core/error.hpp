// The exceptions of the core. Expected numerical outcomes are values in the summary, never
// exceptions.
#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>

namespace sfmcpp {

class Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// A broken contract of a call: the message names the argument, its value and the rule.
class InvalidArgument : public Error {
 public:
  using Error::Error;
};

// Throws it, of an argument with its value.
[[noreturn]] inline void refuse(const std::string& argument, const std::string& rule) {
  throw InvalidArgument(argument + ": " + rule);
}

// "array[k]"
inline std::string entry(const char* array, std::size_t k) {
  return std::string(array) + "[" + std::to_string(k) + "]";
}

}  // namespace sfmcpp

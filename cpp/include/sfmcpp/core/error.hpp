// The exceptions of the core. Expected numerical outcomes are values in the summary, never
// exceptions.
#pragma once

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

}  // namespace sfmcpp

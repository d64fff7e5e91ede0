// What a refused call says.
#pragma once

#include <initializer_list>
#include <string>

#include <gtest/gtest.h>

#include "sfmcpp/core/error.hpp"

namespace sfmcpp::support {

// `f` must throw InvalidArgument with a message that has every one of these parts.
template <class F>
void expect_refused(const F& f, std::initializer_list<std::string> parts) {
  std::string message = "not refused";
  try {
    f();
  } catch (const InvalidArgument& error) {
    message = error.what();
  }
  for (const std::string& part : parts)
    EXPECT_NE(message.find(part), std::string::npos) << message << "\nlacks\n" << part;
}

}  // namespace sfmcpp::support

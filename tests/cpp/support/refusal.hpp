// What a refused call says.
#pragma once

#include <initializer_list>
#include <string>

#include <gtest/gtest.h>

#include "sfmcpp/core/error.hpp"

namespace sfmcpp::support {

// Of the InvalidArgument that `f` throws; "no error" where it throws none.
template <class F>
std::string message_of(const F& f) {
  try {
    f();
  } catch (const InvalidArgument& error) {
    return error.what();
  }
  return "no error";
}

// `f` must throw InvalidArgument with a message that has every one of these parts.
template <class F>
void expect_refused(const F& f, std::initializer_list<std::string> parts) {
  const std::string message = message_of(f);
  for (const std::string& part : parts)
    EXPECT_NE(message.find(part), std::string::npos) << message << "\nlacks\n" << part;
}

}  // namespace sfmcpp::support

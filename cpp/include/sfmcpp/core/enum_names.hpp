// One table of names per enum serves messages, bindings and the command line.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <utility>

#include "sfmcpp/core/error.hpp"

namespace sfmcpp {

// Specialise with `static constexpr std::array<std::pair<E, std::string_view>, N> kTable` and
// `static constexpr std::string_view kWhat` (what the enum chooses, for messages).
template <class E>
struct EnumNames;

template <class E>
constexpr std::string_view enum_name(E value) {
  for (const auto& [candidate, name] : EnumNames<E>::kTable) {
    if (candidate == value) return name;
  }
  return "unknown";
}

template <class E>
E parse_enum(std::string_view text) {
  std::string known;
  for (const auto& [value, name] : EnumNames<E>::kTable) {
    if (name == text) return value;
    known += (known.empty() ? "" : ", ") + std::string(name);
  }
  throw InvalidArgument(std::string(EnumNames<E>::kWhat) + " = '" + std::string(text) +
                        "': must be one of " + known);
}

}  // namespace sfmcpp

// One table per enum holds the facts of its values: their names, what they mean, and facts such as
// "has a damping". Messages, bindings, the command line and the solver read it from there.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>

#include "sfmcpp/core/error.hpp"

namespace sfmcpp {

// Specialise with `static constexpr std::string_view kWhat`, what the enum chooses, for messages,
// and `static constexpr auto kTable`: std::to_array of rows in the order of the values, each with
// at least `value` and `name`. Rows of what a user may choose have a `description` too.
template <class E>
struct EnumTraits;

// A row of an enum without further facts.
template <class E>
struct EnumRow {
  E value;
  std::string_view name;
  std::string_view description = {};
};

template <class E>
constexpr bool is_in_order() {
  for (std::size_t k = 0; k < EnumTraits<E>::kTable.size(); ++k) {
    if (EnumTraits<E>::kTable[k].value != static_cast<E>(k)) return false;
  }
  return true;
}

// Pairs (value, name), to go through all values.
template <class E>
struct EnumNames {
  static_assert(is_in_order<E>(), "the rows of a table are in the order of the enum");
  static constexpr auto kTable = [] {
    std::array<std::pair<E, std::string_view>, EnumTraits<E>::kTable.size()> pairs;
    for (std::size_t k = 0; k < pairs.size(); ++k)
      pairs[k] = {EnumTraits<E>::kTable[k].value, EnumTraits<E>::kTable[k].name};
    return pairs;
  }();
};

// Whether a value, which may come from a number, is one of the enumerators.
template <class E>
constexpr bool is_enumerator(E value) {
  return static_cast<std::size_t>(value) < EnumTraits<E>::kTable.size();
}

// The row of a value.
template <class E>
constexpr const auto& facts_of(E value) {
  static_assert(is_in_order<E>(), "the rows of a table are in the order of the enum");
  return EnumTraits<E>::kTable[static_cast<std::size_t>(value)];
}

template <class E>
constexpr std::string_view enum_name(E value) {
  return is_enumerator(value) ? facts_of(value).name : "unknown";
}

// "method = 'lm'", for messages.
template <class E>
std::string enum_setting(E value) {
  std::string text(EnumTraits<E>::kWhat);
  text += " = '";
  text += enum_name(value);
  text += '\'';
  return text;
}

template <class E>
E parse_enum(std::string_view text) {
  std::string known;
  for (const auto& [value, name] : EnumNames<E>::kTable) {
    if (name == text) return value;
    if (!known.empty()) known += ", ";
    known += name;
  }
  std::string message(EnumTraits<E>::kWhat);
  message.append(" = '").append(text).append("': must be one of ").append(known);
  throw InvalidArgument(message);
}

}  // namespace sfmcpp

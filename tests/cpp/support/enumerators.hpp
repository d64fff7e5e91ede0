// All values of an enumeration, and names of tests after them.
#pragma once

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

#include "sfmcpp/core/enum_names.hpp"

namespace sfmcpp::support {

template <class E>
std::vector<E> all_enumerators() {
  std::vector<E> all;
  for (const auto& [value, name] : EnumNames<E>::kTable) all.push_back(value);
  return all;
}

// What GoogleTest takes for the name of a test.
inline std::string identifier(std::string_view text) {
  std::string name(text);
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}

// "lm_nielsen_sparse", say.
template <class First, class... Others>
std::string identifier_of(First first, Others... others) {
  std::string name(enum_name(first));
  (name.append("_").append(enum_name(others)), ...);
  return identifier(name);
}

}  // namespace sfmcpp::support

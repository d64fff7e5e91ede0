// Whether points that a step makes worse go all of it.
#pragma once

#include <array>
#include <string_view>

#include "sfmcpp/core/enum_names.hpp"

namespace sfmcpp {

namespace optim {
enum class PointSteps { kAuto, kWhole, kHeldBack, kRefitted };
}

template <>
struct EnumTraits<optim::PointSteps> {
  using P = optim::PointSteps;
  static constexpr std::string_view kWhat = "point_steps";
  static constexpr auto kTable = std::to_array<EnumRow<P>>(
      {{P::kAuto, "auto", "refitted where the method can and no line is searched, else whole"},
       {P::kWhole, "whole", "all points as far as the step says"},
       {P::kHeldBack, "held-back", "points that spoil a step are drawn back along it"},
       {P::kRefitted,
        "refitted",
        "held-back, and points beyond the model of a step are fitted to the moved cameras"}});
};

}  // namespace sfmcpp

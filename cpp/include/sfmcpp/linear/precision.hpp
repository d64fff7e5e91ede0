// How the Jacobian of the observations is stored. Whatever is computed with it is computed and
// summed in double precision, and so is the gradient: single precision halves the memory that a
// step passes through and rounds each coefficient of the matrix by at most 2⁻²⁴ of itself, but
// neither the residuals nor what is zero at a minimum.
#pragma once

#include <array>
#include <string_view>

#include "sfmcpp/core/enum_names.hpp"

namespace sfmcpp {

namespace linear {
enum class Precision { kAuto, kSingle, kDouble };
}

template <>
struct EnumTraits<linear::Precision> {
  static constexpr std::string_view kWhat = "precision";
  static constexpr auto kTable = std::to_array<EnumRow<linear::Precision>>(
      {{linear::Precision::kAuto,
        "auto",
        "single for large problems without a robust loss, where it is faster"},
       {linear::Precision::kSingle, "single", "single precision, all sums double"},
       {linear::Precision::kDouble, "double", "double precision"}});
};

namespace linear {

// Of a precision that is not auto.
inline double bytes_of_number(Precision stored) {
  return stored == Precision::kSingle ? sizeof(float) : sizeof(double);
}

// From here on the Jacobian in double precision, 208 bytes an observation of a camera with nine
// columns, leaves a last cache of 32 MB. While it fits, widening costs what the traffic saves.
inline constexpr double kFewestObservationsForSingle = 150000.0;

// `auto` for so many observations on all ranks; anything else is returned as it is.
inline Precision choose_precision(Precision requested, double num_observations) {
  if (requested != Precision::kAuto) return requested;
  return num_observations < kFewestObservationsForSingle ? Precision::kDouble : Precision::kSingle;
}

}  // namespace linear
}  // namespace sfmcpp

#include "sfmcpp/linear/precision.hpp"

namespace sfmcpp::linear {
namespace {

// From here on the Jacobian in double precision, 208 bytes an observation of a camera with nine
// columns, leaves a last cache of 32 MB. While it fits, widening costs what the traffic saves.
constexpr double kFewest = 150000.0;

}  // namespace

Precision choose_precision(Precision requested, double num_observations) {
  if (requested != Precision::kAuto) return requested;
  return num_observations < kFewest ? Precision::kDouble : Precision::kSingle;
}

}  // namespace sfmcpp::linear

#include "sfmcpp/linear/precision.hpp"

namespace sfmcpp::linear {
namespace {

// Where the Jacobian in double precision leaves the second-level cache.
constexpr double kFewest = 4000.0;

}  // namespace

Precision choose_precision(Precision requested, double num_observations) {
  if (requested != Precision::kAuto) return requested;
  return num_observations < kFewest ? Precision::kDouble : Precision::kSingle;
}

}  // namespace sfmcpp::linear

#include "sfmcpp/linear/sum_grid.hpp"

#include <cmath>

namespace sfmcpp::linear {
namespace {

// 2^e > x
int exponent_above(double x) {
  int e = 0;
  std::frexp(x, &e);
  return e;
}

double power_of(double diagonal) {
  if (!(diagonal > 0.0) || !std::isfinite(diagonal)) return 0.0;
  return std::ldexp(1.0, exponent_above(std::sqrt(diagonal)) + 1);
}

}  // namespace

void SumGrid::set(const NormalEquations& normal) {
  const ParameterMap& map = normal.map();
  size_ = map.camera_size;
  powers_.assign(static_cast<std::size_t>(normal.graph().num_cameras * size_), 0.0);
  inverse_ = powers_;
  for (int i = 0; i < normal.graph().num_cameras; ++i) {
    const int* column = map.columns_of(i);
    for (long k = 0; k < size_; ++k) {
      if (column[k] == kNoColumn) continue;
      const double power = power_of(normal.camera_diagonal()[column[k]]);
      powers_[size_ * i + k] = power;
      inverse_[size_ * i + k] = power > 0.0 ? 1.0 / power : 0.0;
    }
  }
}

double middle_of_sum(double largest, double terms) {
  const double bound = largest * terms;
  return 1.5 * std::ldexp(1.0, std::isfinite(bound) ? exponent_above(bound) + 1 : 0);
}

}  // namespace sfmcpp::linear

// Whether the kernels in use multiply and add with one rounding: an instruction set may not have
// that, and a build may not optimise for it. Sums on grids (linear/sum_grid.hpp) need it for their
// last bit.
#pragma once

#include <cmath>

#include "sfmcpp/linear/precision.hpp"
#include "sfmcpp/linear/schur_kernels.hpp"

namespace sfmcpp::support {

inline bool products_are_fused() {
  // (1 + 2⁻³⁰)² − (1 + 2⁻²⁹) = 2⁻⁶⁰, which a product that is rounded first has lost.
  constexpr int kSize = 6;
  const double factor = 1.0 + std::ldexp(1.0, -30);
  double jacobian[2 * kSize] = {factor}, sums[2 * kSize] = {-(1.0 + std::ldexp(1.0, -29))};
  linear::PointRecord record{};
  record.row[0].residual = factor;
  linear::schur_kernels(kSize, linear::Precision::kDouble)
      .camera_gradient(1, jacobian, &record, sums);
  return sums[0] != 0.0;
}

}  // namespace sfmcpp::support

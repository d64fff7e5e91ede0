// Robust losses ρ(s) of the squared residual norm s = ‖r‖², in the cost ½ Σ ρ(s) (thesis §2.3;
// eq. 2.51 with σ and c set right, EQUATIONS §4). All behave like s near zero.
#pragma once

#include <array>
#include <string_view>
#include <utility>

#include "sfmcpp/core/enum_names.hpp"

namespace sfmcpp {

enum class LossKind { kSquared, kHuber, kCauchy, kTukey };

template <>
struct EnumNames<LossKind> {
  static constexpr std::string_view kWhat = "loss";
  static constexpr std::array<std::pair<LossKind, std::string_view>, 4> kTable{
      {{LossKind::kSquared, "squared"},
       {LossKind::kHuber, "huber"},
       {LossKind::kCauchy, "cauchy"},
       {LossKind::kTukey, "tukey"}}};
};

struct Loss {
  LossKind kind = LossKind::kSquared;
  double scale = 1.0;  // c: where the loss leaves the parabola, in units of the residual

  double rho(double s) const;
  double derivative(double s) const;  // dρ/ds: the weight of the observation
};

// The scale with 95 % efficiency on normal residuals of standard deviation sigma: c = 1.345 σ
// (Huber), 2.3849 σ (Cauchy), 4.6851 σ (Tukey); σ itself for the squared loss.
double efficient_scale(LossKind kind, double sigma);

}  // namespace sfmcpp

#include "sfmcpp/residuals/loss.hpp"

#include <cmath>

namespace sfmcpp {

double Loss::rho(double s) const {
  const double c2 = scale * scale;
  switch (kind) {
    case LossKind::kSquared:
      return s;
    case LossKind::kHuber:
      return s <= c2 ? s : 2.0 * scale * std::sqrt(s) - c2;
    case LossKind::kCauchy:
      return c2 * std::log1p(s / c2);
    case LossKind::kTukey: {
      const double rest = s < c2 ? 1.0 - s / c2 : 0.0;
      return c2 / 3.0 * (1.0 - rest * rest * rest);
    }
  }
  return s;
}

double Loss::derivative(double s) const {
  const double c2 = scale * scale;
  switch (kind) {
    case LossKind::kSquared:
      return 1.0;
    case LossKind::kHuber:
      return s <= c2 ? 1.0 : scale / std::sqrt(s);
    case LossKind::kCauchy:
      return 1.0 / (1.0 + s / c2);
    case LossKind::kTukey: {
      const double rest = s < c2 ? 1.0 - s / c2 : 0.0;
      return rest * rest;
    }
  }
  return 1.0;
}

double efficient_scale(LossKind kind, double sigma) {
  switch (kind) {
    case LossKind::kHuber:
      return 1.345 * sigma;
    case LossKind::kCauchy:
      return 2.3849 * sigma;
    case LossKind::kTukey:
      return 4.6851 * sigma;
    case LossKind::kSquared:
      break;
  }
  return sigma;
}

}  // namespace sfmcpp

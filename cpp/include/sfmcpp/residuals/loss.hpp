// Robust losses ρ(s) of the squared residual norm s = ‖r‖², in the cost ½ Σ ρ(s) (thesis §2.3;
// eq. 2.51 with σ and c set right, docs/equations.md §4). All behave like s near zero.
//
// A loss that is no row of the table is a table itself (LossTable).
//
// How to add a loss: a struct like those here, an enumerator and its row in the table.
#pragma once

#include <array>
#include <cmath>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "sfmcpp/core/enum_names.hpp"

namespace sfmcpp {

// A robust loss whose derivative is a table: polynomials of s between knots, and ρ their integral.
// It has the unit scale; Loss scales it.
class LossTable {
 public:
  static constexpr int kTerms = 8;

  // ρ′ between knot k and the next is Σ coefficients[k][i] xⁱ, x from 0 to 1; kTerms of each. Knots
  // rise from zero; beyond the last ρ′ stays what it is there. Throws InvalidArgument if sizes do
  // not fit, knots do not rise, a number is not finite, or ρ′ is negative.
  LossTable(std::string name, std::vector<double> knots, std::vector<double> coefficients);

  const std::string& name() const { return name_; }
  double rho(double s) const;
  double derivative(double s) const;
  double influence_slope(double s) const;  // d(s ρ′)/ds

 private:
  // Where s is in the table.
  struct Place {
    const double* coefficients;
    double x, width;
  };
  void check_weights() const;
  Place place_of(double s) const;
  static double value_at(const Place& place);
  static double integral_to(const Place& place);

  std::string name_;
  std::vector<double> knots_, coefficients_;
  std::vector<double> rho_;  // at the knots
};

enum class LossKind { kSquared, kHuber, kCauchy, kTukey, kGemanMcClure, kTruncated, kAuto };

// Each: ρ; ρ′ = dρ/ds; d(s ρ′)/ds, with c the scale. ρ of no number is none, also where a loss is
// constant: its tests are written so that NaN, which passes none, comes to the formula.
struct SquaredLoss {
  static double rho(double s, double) { return s; }
  static double derivative(double, double) { return 1.0; }
  static double influence_slope(double, double) { return 1.0; }
};

struct HuberLoss {
  static double rho(double s, double c) { return s <= c * c ? s : 2.0 * c * std::sqrt(s) - c * c; }
  static double derivative(double s, double c) { return s <= c * c ? 1.0 : c / std::sqrt(s); }
  static double influence_slope(double s, double c) {
    const double share = s / (c * c);
    return share <= 1.0 ? 1.0 : 0.5 / std::sqrt(share);
  }
};

struct CauchyLoss {
  static double rho(double s, double c) { return c * c * std::log1p(s / (c * c)); }
  static double derivative(double s, double c) { return 1.0 / (1.0 + s / (c * c)); }
  static double influence_slope(double s, double c) {
    const double share = s / (c * c);
    return 1.0 / ((1.0 + share) * (1.0 + share));
  }
};

struct TukeyLoss {
  static double rho(double s, double c) {
    const double rest = s >= c * c ? 0.0 : 1.0 - s / (c * c);
    return c * c / 3.0 * (1.0 - rest * rest * rest);
  }
  static double derivative(double s, double c) {
    const double rest = s >= c * c ? 0.0 : 1.0 - s / (c * c);
    return rest * rest;
  }
  static double influence_slope(double s, double c) {
    const double share = s / (c * c);
    return share >= 1.0 ? 0.0 : (1.0 - share) * (1.0 - 3.0 * share);
  }
};

// Geman & McClure 1985, "Bayesian image analysis".
struct GemanMcClureLoss {
  static double rho(double s, double c) { return s / (1.0 + s / (c * c)); }
  static double derivative(double s, double c) {
    const double rest = 1.0 / (1.0 + s / (c * c));
    return rest * rest;
  }
  static double influence_slope(double s, double c) {
    const double share = s / (c * c);
    return (1.0 - share) / ((1.0 + share) * (1.0 + share) * (1.0 + share));
  }
};

// Squares up to c, constant from 1.5 c on; between them ρ′ falls without a leap (the surrogate of
// truncated least squares of Yang, Antonante, Tzoumas & Carlone 2020, eq. 14, with μ = 2).
struct TruncatedLoss {
  static double rho(double s, double c) {
    if (s <= c * c) return s;
    return s >= 2.25 * c * c ? 1.5 * c * c : 6.0 * c * std::sqrt(s) - 3.0 * c * c - 2.0 * s;
  }
  static double derivative(double s, double c) {
    const double share = s / (c * c);
    if (share <= 1.0) return 1.0;
    return share >= 2.25 ? 0.0 : 3.0 / std::sqrt(share) - 2.0;
  }
  static double influence_slope(double s, double c) {
    const double share = s / (c * c);
    if (share <= 1.0) return 1.0;
    return share >= 2.25 ? 0.0 : 1.5 / std::sqrt(share) - 2.0;
  }
};

using LossFunction = double(double s, double c);

struct LossFacts {
  LossKind value;
  std::string_view name;
  std::string_view description;
  double efficient_scale;  // c/σ of 95 % efficiency on normal residuals of standard deviation σ
  LossFunction* rho;
  LossFunction* derivative;
  LossFunction* influence_slope;
};

template <class L>
constexpr LossFacts loss_facts(LossKind kind,
                               std::string_view name,
                               std::string_view description,
                               double efficient_scale) {
  return {kind, name, description, efficient_scale, L::rho, L::derivative, L::influence_slope};
}

template <>
struct EnumTraits<LossKind> {
  static constexpr std::string_view kWhat = "loss";
  static constexpr auto kTable = std::to_array({
      loss_facts<SquaredLoss>(LossKind::kSquared, "squared", "least squares", 1.0),
      loss_facts<HuberLoss>(LossKind::kHuber, "huber", "linear beyond the scale", 1.345),
      loss_facts<CauchyLoss>(LossKind::kCauchy, "cauchy", "logarithmic", 2.3849),
      loss_facts<TukeyLoss>(LossKind::kTukey, "tukey", "constant beyond the scale", 4.6851),
      loss_facts<GemanMcClureLoss>(
          LossKind::kGemanMcClure, "geman-mcclure", "bends to a constant", 3.7874),
      loss_facts<TruncatedLoss>(LossKind::kTruncated,
                                "truncated",
                                "squared up to the scale, constant from 1.5 times as much on",
                                2.2100),
      loss_facts<TruncatedLoss>(
          LossKind::kAuto, "auto", "truncated, at a scale that falls to the residuals", 2.2100),
  });
};

struct Loss {
  LossKind kind = LossKind::kSquared;
  double scale = 1.0;  // c: where the loss leaves the parabola, in units of the residual
  std::shared_ptr<const LossTable> table{};  // in place of the kind: c² ρ(s / c²)

  bool is_squared() const { return !table && kind == LossKind::kSquared; }
  std::string_view name() const { return table ? table->name() : enum_name(kind); }

  double rho(double s) const {
    if (table) return scale * scale * table->rho(s / (scale * scale));
    return facts_of(kind).rho(s, scale);
  }
  // dρ/ds: the weight of the observation.
  double derivative(double s) const {
    if (table) return table->derivative(s / (scale * scale));
    return facts_of(kind).derivative(s, scale);
  }
  // d(s ρ′)/ds: half the divergence of the influence ρ′ r of a residual of two entries.
  double influence_slope(double s) const {
    if (table) return table->influence_slope(s / (scale * scale));
    return facts_of(kind).influence_slope(s, scale);
  }
};

// Whether ρ can be computed with a scale: its square must be a number too.
inline bool is_loss_scale(double scale) { return scale > 0.0 && std::isnormal(scale * scale); }
inline constexpr const char* kLossScaleRule = "positive and finite, and its square too";

// The scale with 95 % efficiency on normal residuals of standard deviation sigma; sigma itself for
// the squared loss.
inline double efficient_scale(LossKind kind, double sigma) {
  return facts_of(kind).efficient_scale * sigma;
}
// That of a table is not known: sigma itself.
inline double efficient_scale(const Loss& loss, double sigma) {
  return loss.table ? sigma : efficient_scale(loss.kind, sigma);
}

}  // namespace sfmcpp

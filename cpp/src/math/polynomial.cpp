#include "sfmcpp/math/polynomial.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace sfmcpp {
namespace {

using Polynomial = std::vector<double>;

// Roots beyond 2¹⁶⁰ (1e48) are none: with them the others would not fit into the range of a double.
constexpr double kFarthestExponent = 160.0;
// Halving an interval of doubles comes to its end sooner.
constexpr int kMaxRefinements = 2200;

struct Evaluation {
  double value = 0.0;
  double slope = 0.0;
};

Evaluation evaluate(const Polynomial& c, double x) {
  Evaluation result;
  for (auto k = c.rbegin(); k != c.rend(); ++k) {
    result.slope = result.slope * x + result.value;
    result.value = result.value * x + *k;
  }
  return result;
}

// Several times the bound on the rounding of Horner's rule (Higham, Accuracy and Stability of
// Numerical Algorithms, §5.1), because the coefficients have been rounded, too.
double rounding_of_value(const Polynomial& c, double x) {
  double size = 0.0;
  for (auto k = c.rbegin(); k != c.rend(); ++k) size = size * std::abs(x) + std::abs(*k);
  return 4.0 * static_cast<double>(c.size()) * kMachineEpsilon * size;
}

// 0 where rounding hides it.
int sign_of_value(const Polynomial& c, double x) {
  const double value = evaluate(c, x).value;
  if (std::abs(value) <= rounding_of_value(c, x)) return 0;
  return value > 0.0 ? 1 : -1;
}

Polynomial derivative(const Polynomial& c) {
  Polynomial result(c.size() - 1);
  for (std::size_t k = 1; k < c.size(); ++k) result[k - 1] = static_cast<double>(k) * c[k];
  return result;
}

// The root in an interval at whose ends the signs differ and in which the slope keeps its sign:
// Newton steps, bisection where they leave the interval or shrink too slowly.
double root_between(const Polynomial& c, double low, double high) {
  const bool rises = evaluate(c, high).value > 0.0;
  double x = 0.5 * (low + high);
  double step = high - low;
  for (int i = 0; i < kMaxRefinements; ++i) {
    const auto [value, slope] = evaluate(c, x);
    if (value == 0.0) break;
    ((value > 0.0) == rises ? high : low) = x;
    const double newton = -value / slope;
    const bool trusted =
        x + newton > low && x + newton < high && std::abs(newton) < 0.5 * std::abs(step);
    step = trusted ? newton : 0.5 * (low + high) - x;
    x += step;
    if (std::abs(step) <= kMachineEpsilon * std::abs(x)) break;
  }
  return x;
}

// Roots in [−1, 1]: between two neighbouring roots of the derivative there is at most one.
std::vector<double> roots_in_unit_interval(const Polynomial& c) {
  if (c.size() < 2) return {};
  std::vector<double> knots = roots_in_unit_interval(derivative(c));
  knots.insert(knots.begin(), -1.0);
  knots.push_back(1.0);
  std::vector<double> roots;
  int before = 1;
  for (std::size_t i = 0; i < knots.size(); ++i) {
    const int sign = sign_of_value(c, knots[i]);
    if (i > 0 && sign * before < 0) roots.push_back(root_between(c, knots[i - 1], knots[i]));
    if (sign == 0 && (i == 0 || before != 0)) roots.push_back(knots[i]);
    before = sign;
  }
  return roots;
}

// log₂ of a bound on the size of the roots (Fujiwara 1916). The constant term must not be zero.
double bound_exponent(const Polynomial& c) {
  const double leading = std::log2(std::abs(c.back()));
  double exponent = -std::numeric_limits<double>::infinity();
  for (std::size_t k = 1; k < c.size(); ++k) {
    const double lower = std::log2(std::abs(c[c.size() - 1 - k]));
    exponent = std::max(exponent, (lower - leading) / static_cast<double>(k));
  }
  return 1.0 + exponent;
}

bool leading_coefficient_is_negligible(const Polynomial& c) {
  return c.back() == 0.0 || (c.size() > 1 && bound_exponent(c) > kFarthestExponent);
}

// In units of 2^exponent for x, and of a power of two near the leading term: nothing is rounded.
Polynomial in_units(const Polynomial& c, int exponent) {
  const int degree = static_cast<int>(c.size()) - 1;
  const int leading = std::ilogb(c.back()) + degree * exponent;
  Polynomial result;
  for (int k = 0; k <= degree; ++k)
    result.push_back(std::ldexp(c[static_cast<std::size_t>(k)], k * exponent - leading));
  return result;
}

// Roots of a polynomial whose constant term and leading coefficient are not zero.
std::vector<double> roots_but_zero(const Polynomial& c) {
  if (c.size() < 2) return {};
  const int exponent = static_cast<int>(std::ceil(bound_exponent(c)));
  std::vector<double> roots = roots_in_unit_interval(in_units(c, exponent));
  for (double& root : roots) root = std::ldexp(root, exponent);
  return roots;
}

bool all_finite(std::span<const double> values) {
  return std::ranges::all_of(values, [](double v) { return std::isfinite(v); });
}

}  // namespace

std::vector<double> real_roots(std::span<const double> coefficients) {
  const auto lowest = std::ranges::find_if(coefficients, [](double c) { return c != 0.0; });
  if (lowest == coefficients.end() || !all_finite(coefficients)) return {};
  Polynomial c(lowest, coefficients.end());
  while (leading_coefficient_is_negligible(c)) c.pop_back();
  std::vector<double> roots = roots_but_zero(c);
  if (lowest != coefficients.begin()) roots.insert(std::ranges::lower_bound(roots, 0.0), 0.0);
  return roots;
}

}  // namespace sfmcpp

#include "sfmcpp/math/biquadratic.hpp"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <optional>
#include <utility>

#include "sfmcpp/math/polynomial.hpp"

namespace sfmcpp {
namespace {

using Pair = std::array<double, 2>;

// What counts as a vanishing gradient or denominator, relative to the terms of which it is the sum.
constexpr double kVanishing = 1e-8;
// Stationary points nearer to each other than this, relatively, are one.
constexpr double kSame = 1e-9;
constexpr int kNewtonSteps = 8;

struct Sum {
  double value = 0.0;
  double size = 0.0;  // Σ |term|: what its rounding is relative to

  double relative() const { return size == 0.0 ? 0.0 : std::abs(value) / size; }
  bool is_rounding() const { return std::abs(value) <= 8.0 * kMachineEpsilon * size; }
};

Sum sum(std::initializer_list<double> terms) {
  Sum result;
  for (double term : terms) {
    result.value += term;
    result.size += std::abs(term);
  }
  return result;
}

// A coefficient of which only rounding is left would add roots far away.
double coefficient(std::initializer_list<double> terms) {
  const Sum s = sum(terms);
  return s.is_rounding() ? 0.0 : s.value;
}

std::array<Sum, 2> gradient_sums(const Biquadratic& f, double x, double y) {
  return {
      sum({f.ap, x * f.pp, y * f.pq, 2.0 * x * y * f.pc, y * y * f.qc, x * y * y * f.cc}),
      sum({f.aq, y * f.qq, x * f.pq, 2.0 * x * y * f.qc, x * x * f.pc, x * x * y * f.cc}),
  };
}

double relative_gradient(const Biquadratic& f, const Pair& at) {
  const auto [x, y] = gradient_sums(f, at[0], at[1]);
  return std::hypot(x.relative(), y.relative());
}

Pair newton_step(const Biquadratic& f, const Pair& at) {
  const auto [x, y] = at;
  const auto [gx, gy] = f.gradient(x, y);
  const double xx = f.pp + 2.0 * y * f.pc + y * y * f.cc;
  const double yy = f.qq + 2.0 * x * f.qc + x * x * f.cc;
  const double xy = f.pq + 2.0 * x * f.pc + 2.0 * y * f.qc + 2.0 * x * y * f.cc;
  const double determinant = xx * yy - xy * xy;
  return {x - (yy * gx - xy * gy) / determinant, y - (xx * gy - xy * gx) / determinant};
}

// As long as the gradient becomes smaller: one that is not finite does not.
Pair polished(const Biquadratic& f, Pair at) {
  double gradient = relative_gradient(f, at);
  for (int i = 0; i < kNewtonSteps; ++i) {
    const Pair next = newton_step(f, at);
    const double next_gradient = relative_gradient(f, next);
    if (!(next_gradient < gradient)) break;
    at = next;
    gradient = next_gradient;
  }
  return at;
}

// Υ, ascending: −φ′ D², where φ(x) is the cost that is left when y has its best value and D the
// denominator of eq. 4.19.
std::array<double, 6> quintic(const Biquadratic& f) {
  const auto& [aa, ap, aq, pp, qq, pq, pc, qc, cc] = f;
  return {
      coefficient({-ap * qq * qq, -qc * aq * aq, pq * aq * qq}),
      coefficient(
          {pq * pq * qq, 2.0 * pc * aq * qq, -4.0 * ap * qc * qq, -cc * aq * aq, -pp * qq * qq}),
      coefficient({pq * pq * qc,
                   -4.0 * pp * qc * qq,
                   -4.0 * ap * qc * qc,
                   2.0 * qc * aq * pc,
                   -2.0 * ap * cc * qq,
                   -pq * aq * cc,
                   3.0 * pq * pc * qq}),
      coefficient({-4.0 * pp * qc * qc,
                   -4.0 * ap * qc * cc,
                   -2.0 * pp * cc * qq,
                   4.0 * pq * pc * qc,
                   2.0 * pc * pc * qq}),
      coefficient({3.0 * qc * pc * pc, -4.0 * pp * qc * cc, pq * pc * cc, -ap * cc * cc}),
      coefficient({-pp * cc * cc, pc * pc * cc}),
  };
}

// Eq. 4.19; none where the points' length changes nothing.
std::optional<double> point_length(const Biquadratic& f, double x) {
  const Sum denominator = sum({f.qq, 2.0 * x * f.qc, x * x * f.cc});
  if (denominator.relative() <= kVanishing) return std::nullopt;
  return -(f.aq + x * f.pq + x * x * f.pc) / denominator.value;
}

bool near(double a, double b) {
  return std::abs(a - b) <= kSame * std::max(std::abs(a), std::abs(b));
}

std::vector<Pair> without_repetitions(std::vector<Pair> pairs) {
  std::ranges::sort(pairs);
  const auto same = [](const Pair& a, const Pair& b) {
    return near(a[0], b[0]) && near(a[1], b[1]);
  };
  pairs.erase(std::unique(pairs.begin(), pairs.end(), same), pairs.end());
  return pairs;
}

std::vector<Pair> stationary_pairs_of_balanced(const Biquadratic& f) {
  std::vector<Pair> pairs;
  for (double x : real_roots(quintic(f))) {
    const std::optional<double> y = point_length(f, x);
    if (!y) continue;
    const Pair pair = polished(f, {x, *y});
    if (relative_gradient(f, pair) <= kVanishing) pairs.push_back(pair);
  }
  return without_repetitions(std::move(pairs));
}

// Powers of two in which to measure the two lengths and the cost, so that the sums are of like
// size and rounding stays what it was.
struct Units {
  int x = 0;
  int y = 0;
  int cost = 0;
};

int half_ratio(double numerator, double denominator) {
  return (std::ilogb(numerator) - std::ilogb(denominator)) / 2;
}

// At a length of one unit a step is to change the residual by the size of the residual; a step that
// changes nothing alone is measured by what it does to the other.
Units balancing_units(const Biquadratic& f) {
  const double cost = f.aa > 0.0 ? f.aa : 1.0;
  return {.x = f.pp > 0.0 ? half_ratio(cost, f.pp) : half_ratio(f.qq, f.cc),
          .y = f.qq > 0.0 ? half_ratio(cost, f.qq) : half_ratio(f.pp, f.cc),
          .cost = std::ilogb(cost)};
}

Biquadratic in_units(const Biquadratic& f, const Units& u) {
  const auto scaled = [&](double value, int x, int y) {
    return std::ldexp(value, x * u.x + y * u.y - u.cost);
  };
  return {.aa = scaled(f.aa, 0, 0),
          .ap = scaled(f.ap, 1, 0),
          .aq = scaled(f.aq, 0, 1),
          .pp = scaled(f.pp, 2, 0),
          .qq = scaled(f.qq, 0, 2),
          .pq = scaled(f.pq, 1, 1),
          .pc = scaled(f.pc, 2, 1),
          .qc = scaled(f.qc, 1, 2),
          .cc = scaled(f.cc, 2, 2)};
}

bool all_finite(const Biquadratic& f) {
  const auto& [aa, ap, aq, pp, qq, pq, pc, qc, cc] = f;
  return std::isfinite(sum({aa, ap, aq, pp, qq, pq, pc, qc, cc}).size);
}

// The cost does not see the cameras' step, or not the points': the other length is free.
bool ignores_cameras(const Biquadratic& f) { return f.pp <= 0.0 && f.cc <= 0.0; }
bool ignores_points(const Biquadratic& f) { return f.qq <= 0.0 && f.cc <= 0.0; }
bool changes_only_jointly(const Biquadratic& f) { return f.pp <= 0.0 && f.qq <= 0.0; }

}  // namespace

double Biquadratic::value(double x, double y) const {
  return 0.5 * (aa + x * x * pp + y * y * qq + x * x * y * y * cc) + x * ap + y * aq + x * y * pq +
         x * y * (x * pc + y * qc);
}

std::array<double, 2> Biquadratic::gradient(double x, double y) const {
  const auto [dx, dy] = gradient_sums(*this, x, y);
  return {dx.value, dy.value};
}

std::vector<double> Biquadratic::stationary_lengths() const {
  return real_roots(std::array{ap + aq, pp + qq + 2.0 * pq, 3.0 * (pc + qc), 2.0 * cc});
}

std::vector<std::array<double, 2>> Biquadratic::stationary_pairs() const {
  if (!all_finite(*this) || changes_only_jointly(*this)) return {};
  if (ignores_cameras(*this)) return {{1.0, -aq / qq}};
  if (ignores_points(*this)) return {{-ap / pp, 1.0}};
  const Units units = balancing_units(*this);
  const Biquadratic balanced = in_units(*this, units);
  if (!all_finite(balanced)) return {};
  std::vector<Pair> pairs = stationary_pairs_of_balanced(balanced);
  for (auto& [x, y] : pairs) {
    x = std::ldexp(x, units.x);
    y = std::ldexp(y, units.y);
  }
  return pairs;
}

}  // namespace sfmcpp

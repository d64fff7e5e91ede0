// Costs along a line, with their derivatives, that line searches are tested on. All descend at 0.
#pragma once

#include <cmath>
#include <limits>
#include <numbers>
#include <ostream>

namespace sfmcpp::support {

struct Function {
  const char* name;
  double (*cost)(double);
  double (*slope)(double);

  friend void PrintTo(const Function& f, std::ostream* stream) { *stream << f.name; }
};

// Moré & Thuente, Line search algorithms with guaranteed sufficient decrease, 1994: equation 5.1
// with β = 2.
inline double more_thuente_1(double a) { return -a / (a * a + 2.0); }
inline double more_thuente_1_slope(double a) {
  return (a * a - 2.0) / ((a * a + 2.0) * (a * a + 2.0));
}

// Equation 5.2 with β = 0.004.
inline double more_thuente_2(double a) {
  const double s = a + 0.004;
  return std::pow(s, 5) - 2.0 * std::pow(s, 4);
}
inline double more_thuente_2_slope(double a) {
  const double s = a + 0.004;
  return 5.0 * std::pow(s, 4) - 8.0 * std::pow(s, 3);
}

// Equation 5.3 with β = 0.01, l = 39: a kink at 1, rounded, and waves on it.
inline constexpr double kBeta = 0.01, kWaves = 39.0 * std::numbers::pi / 2.0;
inline double more_thuente_3(double a) {
  const double wave = (1.0 - kBeta) / kWaves * std::sin(kWaves * a);
  if (a <= 1.0 - kBeta) return 1.0 - a + wave;
  if (a >= 1.0 + kBeta) return a - 1.0 + wave;
  return 0.5 / kBeta * (a - 1.0) * (a - 1.0) + 0.5 * kBeta + wave;
}
inline double more_thuente_3_slope(double a) {
  const double wave = (1.0 - kBeta) * std::cos(kWaves * a);
  if (a <= 1.0 - kBeta) return -1.0 + wave;
  if (a >= 1.0 + kBeta) return 1.0 + wave;
  return (a - 1.0) / kBeta + wave;
}

// Rosenbrock's valley from (−1.2, 1) along (2.2, −4).
inline double rosenbrock(double a) {
  const double x = -1.2 + 2.2 * a, y = 1.0 - 4.0 * a;
  return 100.0 * (y - x * x) * (y - x * x) + (1.0 - x) * (1.0 - x);
}
inline double rosenbrock_slope(double a) {
  const double x = -1.2 + 2.2 * a, y = 1.0 - 4.0 * a;
  return 200.0 * (y - x * x) * (-4.0 - 4.4 * x) - 4.4 * (1.0 - x);
}

// Quadratics with their minimum at a third of the unit length, at it, and at four times of it.
inline double third(double a) { return (a - 1.0 / 3.0) * (a - 1.0 / 3.0); }
inline double third_slope(double a) { return 2.0 * (a - 1.0 / 3.0); }
inline double unit(double a) { return 5.0 + (a - 1.0) * (a - 1.0); }
inline double unit_slope(double a) { return 2.0 * (a - 1.0); }
inline double fourfold(double a) { return (a - 4.0) * (a - 4.0); }
inline double fourfold_slope(double a) { return 2.0 * (a - 4.0); }

// A step far too long, and a cost that is infinite soon after its minimum.
inline double steep(double a) { return std::cosh(30.0 * a - 1.0); }
inline double steep_slope(double a) { return 30.0 * std::sinh(30.0 * a - 1.0); }
inline double barrier(double a) {
  return a < 0.3 ? -2.0 * a - 0.2 * std::log(0.3 - a) : std::numeric_limits<double>::infinity();
}
inline double barrier_slope(double a) {
  return a < 0.3 ? -2.0 + 0.2 / (0.3 - a) : std::numeric_limits<double>::quiet_NaN();
}

inline constexpr Function kFunctions[] = {
    {"MoreThuente1", more_thuente_1, more_thuente_1_slope},
    {"MoreThuente2", more_thuente_2, more_thuente_2_slope},
    {"MoreThuente3", more_thuente_3, more_thuente_3_slope},
    {"Rosenbrock", rosenbrock, rosenbrock_slope},
    {"Third", third, third_slope},
    {"Unit", unit, unit_slope},
    {"Fourfold", fourfold, fourfold_slope},
    {"Steep", steep, steep_slope},
    {"Barrier", barrier, barrier_slope},
};

}  // namespace sfmcpp::support

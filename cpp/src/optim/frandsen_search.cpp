// Soft and exact line search after Frandsen, Jonasson, Nielsen, Tingleff: Unconstrained
// Optimization, 2nd ed., IMM DTU 1999, §2.5 and §2.6. One algorithm: go on while the cost falls
// steeply, then refine the bracket.
//
// Where this differs: cost and slope are known where they were asked for before, and instead of the
// length zero, or of one that is worse than the unit length, the best length seen is returned.
#include <algorithm>
#include <limits>

#include "sampled_line.hpp"
#include "sfmcpp/optim/line_search.hpp"

namespace sfmcpp::optim {
namespace {

constexpr double kMaxLength = 10.0;
constexpr int kMaxTrials = 10;
// ϱ: of the tangent below which the cost has to come, λ(α) = φ(0) + ϱ φ′(0) α.
constexpr double kTangentFraction = 1e-3;
// Of a bracket, next to its ends: no new length lies there.
constexpr double kMargin = 0.1;

// When a length is good enough. Slopes are fractions of φ′(0) < 0: positive downhill, negative
// uphill.
struct Precision {
  double steepest_descent = 0.0;  // steeper than this: not far enough
  double steepest_ascent = 0.0;   // steeper than this: too far
  double bracket = 0.0;           // no narrower bracket is refined
};

// One search.
class Bracketing {
 public:
  Bracketing(StepLine& line, const Precision& precision) : line_(line), precision_(precision) {}

  double run() {
    if (!line_.descends()) return 1.0;
    expand();
    while (!done()) refine();
    const bool worth_it = acceptable(length_) && line_.cost(length_) <= line_.cost(1.0);
    return worth_it ? length_ : line_.best_length();
  }

 private:
  bool below_tangent(double length) {
    return line_.cost(length) <=
           line_.start_cost() + kTangentFraction * line_.start_slope() * length;
  }

  double slope_fraction(double length) { return line_.slope(length) / line_.start_slope(); }

  bool falls_steeply(double length) {
    return below_tangent(length) && slope_fraction(length) > precision_.steepest_descent;
  }

  bool acceptable(double length) {
    return below_tangent(length) && slope_fraction(length) <= precision_.steepest_descent &&
           slope_fraction(length) >= precision_.steepest_ascent;
  }

  bool can_evaluate() const { return line_.evaluations() < kMaxTrials; }

  void expand() {
    while (falls_steeply(high_) && high_ < kMaxLength && can_evaluate()) {
      low_ = high_;
      high_ = std::min(2.0 * high_, kMaxLength);
    }
    length_ = high_;
  }

  bool done() {
    return !can_evaluate() || acceptable(length_) || falls_steeply(high_) ||
           high_ - low_ <= precision_.bracket;
  }

  // Below the tangent and downhill at the low end, above it or uphill at the high end: a minimum
  // stays between them.
  void refine() {
    length_ = line_.parabola_minimum(low_, high_, kMargin, 1.0 - kMargin);
    const bool before_minimum = below_tangent(length_) && line_.slope(length_) < 0.0;
    (before_minimum ? low_ : high_) = length_;
  }

  SampledLine line_;
  Precision precision_;
  double low_ = 0.0;
  double high_ = 1.0;
  double length_ = 1.0;
};

class FrandsenSearch final : public LineSearch {
 public:
  explicit FrandsenSearch(const Precision& precision) : precision_(precision) {}

  LineSearchResult search(StepLine& line) const override {
    const double length = Bracketing(line, precision_).run();
    return {.lengths = {length, length}};
  }

 private:
  Precision precision_;
};

}  // namespace

std::unique_ptr<LineSearch> make_exact_search(const LineSearchOptions&) {
  return std::make_unique<FrandsenSearch>(
      Precision{.steepest_descent = 1e-3, .steepest_ascent = -1e-3, .bracket = 1e-3});
}

std::unique_ptr<LineSearch> make_soft_search(const LineSearchOptions&) {
  constexpr double kAny = -std::numeric_limits<double>::infinity();
  return std::make_unique<FrandsenSearch>(
      Precision{.steepest_descent = 0.99, .steepest_ascent = kAny});
}

}  // namespace sfmcpp::optim

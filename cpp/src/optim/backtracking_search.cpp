#include <limits>

#include "sampled_line.hpp"
#include "sfmcpp/optim/line_search.hpp"

namespace sfmcpp::optim {
namespace {

constexpr int kMaxEvaluations = 20;
// ω₂ of the Wolfe conditions (thesis eq. 2.39), c of Goldstein's (eq. 2.40).
constexpr double kSlopeFraction = 0.9;
constexpr double kGoldstein = 0.25;
// A new length lies between these fractions of the bracket.
constexpr double kLeastFraction = 0.1;
constexpr double kGreatestFraction = 0.5;

enum class Verdict { kTooShort, kGood, kTooLong };
using Test = Verdict (*)(SampledLine&, double length);

// F(x) + fraction · α ∇ᵀδ.
double tangent(const SampledLine& line, double length, double fraction) {
  return line.start_cost() + fraction * length * line.start_slope();
}

Verdict armijo(SampledLine& line, double length) {
  const bool decreases = line.cost(length) <= tangent(line, length, kSufficientDecrease);
  return decreases ? Verdict::kGood : Verdict::kTooLong;
}

Verdict strong_wolfe(SampledLine& line, double length) {
  if (armijo(line, length) == Verdict::kTooLong) return Verdict::kTooLong;
  const double fraction = line.slope(length) / line.start_slope();
  if (fraction > kSlopeFraction) return Verdict::kTooShort;
  return fraction >= -kSlopeFraction ? Verdict::kGood : Verdict::kTooLong;
}

Verdict goldstein(SampledLine& line, double length) {
  const double cost = line.cost(length);
  if (cost < tangent(line, length, 1.0 - kGoldstein)) return Verdict::kTooShort;
  return cost <= tangent(line, length, kGoldstein) ? Verdict::kGood : Verdict::kTooLong;
}

// What is known to be too short, and what too long. For each of the tests a good length lies
// between the two if the cost is smooth (Nocedal & Wright, Numerical Optimization, lemma 3.1).
struct Bracket {
  double too_short = 0.0;
  double too_long = std::numeric_limits<double>::infinity();

  bool is_open() const { return too_long == std::numeric_limits<double>::infinity(); }
  double middle() const { return 0.5 * (too_short + too_long); }
};

double next_length(SampledLine& line, const Bracket& bracket) {
  if (bracket.is_open()) return 2.0 * bracket.too_short;
  if (!line.slope_is_known(bracket.too_short)) return bracket.middle();
  return line.parabola_minimum(
      bracket.too_short, bracket.too_long, kLeastFraction, kGreatestFraction);
}

// The first good length; if there is none within the evaluations allowed, or if the step is not one
// of descent, the best length seen.
double good_length(SampledLine& line, Test test) {
  Bracket bracket;
  double length = 1.0;
  while (line.descends() && line.evaluations() < kMaxEvaluations) {
    const Verdict verdict = test(line, length);
    if (verdict == Verdict::kGood) return length;
    (verdict == Verdict::kTooLong ? bracket.too_long : bracket.too_short) = length;
    length = next_length(line, bracket);
  }
  return line.best_length();
}

class BacktrackingSearch final : public LineSearch {
 public:
  explicit BacktrackingSearch(Test test) : test_(test) {}

  LineSearchResult search(StepLine& line) const override {
    SampledLine sampled(line);
    const double length = good_length(sampled, test_);
    return {.lengths = {length, length}};
  }

 private:
  Test test_;
};

Test test_of(BacktrackingTest test) {
  switch (test) {
    case BacktrackingTest::kArmijo:
      return armijo;
    case BacktrackingTest::kStrongWolfe:
      return strong_wolfe;
    case BacktrackingTest::kGoldstein:
      return goldstein;
  }
  return armijo;
}

}  // namespace

std::unique_ptr<LineSearch> make_backtracking_search(const LineSearchOptions& options) {
  return std::make_unique<BacktrackingSearch>(test_of(options.backtracking_test));
}

}  // namespace sfmcpp::optim

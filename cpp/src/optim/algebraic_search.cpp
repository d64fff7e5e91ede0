#include <algorithm>
#include <cmath>

#include "sfmcpp/optim/line_search.hpp"

namespace sfmcpp::optim {
namespace {

// Lengths that differ by less are not worth another evaluation of the cost.
constexpr double kSameLength = 1e-6;

constexpr StepLengths kUnit{};

using Proposals = std::vector<StepLengths> (*)(const Biquadratic&);

std::vector<StepLengths> common_lengths(const Biquadratic& cost) {
  std::vector<StepLengths> lengths;
  for (double length : cost.stationary_lengths()) lengths.push_back({length, length});
  return lengths;
}

std::vector<StepLengths> separate_lengths(const Biquadratic& cost) {
  std::vector<StepLengths> lengths;
  for (const auto& [camera, point] : cost.stationary_pairs()) lengths.push_back({camera, point});
  return lengths;
}

bool is_unit(const StepLengths& lengths) {
  return std::abs(lengths.camera - 1.0) <= kSameLength &&
         std::abs(lengths.point - 1.0) <= kSameLength;
}

struct Candidate {
  StepLengths lengths{};
  double cost = 0.0;
};

// A′ of algorithms 6 and 7.
std::vector<Candidate> better_than_unit(StepLine& line, const std::vector<StepLengths>& proposed) {
  std::vector<Candidate> better;
  if (std::ranges::all_of(proposed, is_unit)) return better;
  const double unit_cost = line.cost(kUnit);
  for (const StepLengths& lengths : proposed) {
    if (is_unit(lengths)) continue;
    const double cost = line.cost(lengths);
    if (std::isfinite(cost) && !(unit_cost <= cost)) better.push_back({lengths, cost});
  }
  return better;
}

// By how much the decrease exceeds what the first Wolfe condition asks for: ε_ω₁.
double wolfe_excess(const StepLine& line, const Candidate& candidate) {
  const linear::Slopes slopes = line.slopes_at_start();
  const StepLengths& lengths = candidate.lengths;
  const double tangent = slopes.camera * lengths.camera + slopes.point * lengths.point;
  return line.cost_at_start() + kSufficientDecrease * tangent - candidate.cost;
}

StepLengths largest_wolfe_excess(const StepLine& line, const std::vector<Candidate>& candidates) {
  StepLengths best = kUnit;
  double largest = 0.0;
  for (const Candidate& candidate : candidates) {
    const double excess = wolfe_excess(line, candidate);
    if (excess > largest) {
      largest = excess;
      best = candidate.lengths;
    }
  }
  return best;
}

// Algorithms 6 and 7, which are one. A single better length is taken as it is: the minimiser
// rejects it if it does not decrease the cost. The thesis leaves open what to do when none of
// several meets the condition: the unit step.
StepLengths select(StepLine& line, const std::vector<StepLengths>& proposed) {
  const std::vector<Candidate> better = better_than_unit(line, proposed);
  if (better.empty()) return kUnit;
  if (better.size() == 1) return better.front().lengths;
  return largest_wolfe_excess(line, better);
}

class AlgebraicSearch final : public LineSearch {
 public:
  explicit AlgebraicSearch(Proposals proposals) : proposals_(proposals) {}

  LineSearchResult search(StepLine& line) const override {
    const std::optional<Biquadratic> cost = line.algebraic_cost();
    if (!cost) return {};
    const std::vector<StepLengths> proposed = proposals_(*cost);
    return {.lengths = select(line, proposed), .proposed = proposed};
  }

 private:
  Proposals proposals_;
};

}  // namespace

std::unique_ptr<LineSearch> make_global_algebraic_search(const LineSearchOptions&) {
  return std::make_unique<AlgebraicSearch>(common_lengths);
}

std::unique_ptr<LineSearch> make_two_way_algebraic_search(const LineSearchOptions&) {
  return std::make_unique<AlgebraicSearch>(separate_lengths);
}

}  // namespace sfmcpp::optim

// How far along a step to go.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "sfmcpp/optim/model.hpp"
#include "sfmcpp/optim/options.hpp"

namespace sfmcpp::optim {

// ω₁ of the Wolfe conditions (thesis eq. 2.37): the share of the tangent's decrease that is enough.
inline constexpr double kSufficientDecrease = 1e-4;

// The cost along one step from one state: all that a line search sees.
class StepLine {
 public:
  virtual ~StepLine() = default;

  virtual double cost_at_start() const = 0;
  // ∂F/∂(length of the cameras) and ∂F/∂(length of the points) at zero lengths; their sum is
  // negative for a direction of descent.
  virtual linear::Slopes slopes_at_start() const = 0;
  // F(x + lengths ∘ δ); infinite where it is not finite.
  virtual double cost(StepLengths lengths) = 0;
  // dF/dα at both lengths α.
  virtual double slope(double length) = 0;
  virtual std::optional<Biquadratic> algebraic_cost() = 0;
};

struct LineSearchResult {
  StepLengths lengths{};                // the choice
  std::vector<StepLengths> proposed{};  // what an algebraic search proposed, accepted or not
};

class LineSearch {
 public:
  virtual ~LineSearch() = default;
  virtual LineSearchResult search(StepLine& line) const = 0;
};

// Null for LineSearchKind::kNone.
inline std::unique_ptr<LineSearch> make_line_search(const LineSearchOptions& options) {
  LineSearchFactory* make = facts_of(options.kind).make;
  return make == nullptr ? nullptr : make(options);
}

}  // namespace sfmcpp::optim

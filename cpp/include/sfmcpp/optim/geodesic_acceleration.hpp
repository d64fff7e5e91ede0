// Geodesic acceleration (Transtrum & Sethna, arXiv 1201.5885): a step along the parabola
// α v + ½ α² a, whose acceleration a solves the damped system of the step v for the second
// derivative of the residuals along v, with the factors that are there. The cameras may be left to
// go straight: then a is V*⁻¹ of each point times a sum over its observations, a third of the cost.
//
// The paper refuses a as a whole where 2 ‖a‖ / ‖v‖ is above a bound. A bundle has thousands of
// points, and a few badly seen ones would decide for all: here each point and each block of cameras
// has its own part of a, at most 0.7 times as long as its part of v (lengths in units of
// diag(JᵀJ)).
#pragma once

#include <array>
#include <string_view>

#include "sfmcpp/core/enum_names.hpp"
#include "sfmcpp/linear/linear_solver.hpp"
#include "sfmcpp/optim/model.hpp"

namespace sfmcpp {

namespace optim {
enum class Acceleration { kAuto, kNone, kPoints, kGeodesic };
}

template <>
struct EnumTraits<optim::Acceleration> {
  using A = optim::Acceleration;
  static constexpr std::string_view kWhat = "acceleration";
  static constexpr auto kTable = std::to_array<EnumRow<A>>(
      {{A::kAuto,
        "auto",
        "geodesic after steps that leave less than a third of the cost, where a direct linear "
        "solver can and no line is searched, else none"},
       {A::kNone, "none", "straight steps"},
       {A::kPoints, "points", "geodesic, of the points: the cameras go straight"},
       {A::kGeodesic, "geodesic", "geodesic, of all unknowns, by a direct linear solver"}});
};

namespace optim {

struct MinimizerOptions;

class GeodesicAcceleration {
 public:
  explicit GeodesicAcceleration(const MinimizerOptions& options);

  bool is_possible() const { return possible_; }
  // `share_left`: of the cost, by the last step taken.
  bool is_due(const linear::LinearSolver& solver, double share_left) const;
  // v + ½ a for the step v that `solver` solved for last; null where it is not finite.
  const linear::Step* bend(LeastSquaresModel& model,
                           linear::LinearSolver& solver,
                           const State& state,
                           const linear::Step& step);

 private:
  bool possible_;
  double largest_share_;  // that is left where a step is bent
  linear::Unknowns unknowns_;
  linear::Step bent_;
};

}  // namespace optim
}  // namespace sfmcpp

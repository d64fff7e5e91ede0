// Real roots of polynomials of small degree.
#pragma once

#include <limits>
#include <span>
#include <vector>

namespace sfmcpp {

inline constexpr double kMachineEpsilon = std::numeric_limits<double>::epsilon();

// The real roots of c₀ + c₁ x + … + cₙ xⁿ, ascending, each root once however often it counts. They
// are found between the roots of the derivative, recursively, by Newton steps safeguarded by
// bisection: no complex arithmetic, and a simple root is right to what rounding leaves of the
// coefficients, of whatever sizes they are. Roots that rounding cannot tell apart are one. A
// leading coefficient is dropped if it is so small beside the others that roots may lie beyond
// 1e48. The zero polynomial, and one with a coefficient that is not finite, has no roots.
std::vector<double> real_roots(std::span<const double> coefficients);

}  // namespace sfmcpp

// Steps as vectors: the cameras' part is the same on every rank, the points' part is distributed
// over the ranks.
#pragma once

#include "sfmcpp/linear/normal_equations.hpp"

namespace sfmcpp::linear {

double dot(const NormalEquations& normal, const Step& a, const Step& b);
double norm(const NormalEquations& normal, const Step& x);
// x ← s x
void scale(const NormalEquations& normal, double s, Step& x);
// y ← y + s x
void add_scaled(const NormalEquations& normal, double s, const Step& x, Step& y);

// b = Jᵀ r.
Step negative_gradient(const NormalEquations& normal);
// Sum of the decreases of the quadratic model if each parameter moved alone, ½ bᵀD⁻¹b: independent
// of damping and of units.
double decrease_by_each_alone(const NormalEquations& normal);
// The entries of D, in the shape of a step.
Step damping_entries(const NormalEquations& normal, DampingMatrix matrix);

// The metric of a diagonal matrix with positive entries.
double dot(const NormalEquations& normal, const Step& a, const Step& metric, const Step& b);
double norm(const NormalEquations& normal, const Step& x, const Step& metric);
// metric⁻¹ g
Step divide(const NormalEquations& normal, const Step& g, const Step& metric);

}  // namespace sfmcpp::linear

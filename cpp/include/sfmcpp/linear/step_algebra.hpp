// Steps as vectors.
#pragma once

#include "sfmcpp/linear/normal_equations.hpp"

namespace sfmcpp::linear {

double dot(const Step& a, const Step& b);
// x ← s x
void scale(double s, Step& x);
// y ← y + s x
void add_scaled(double s, const Step& x, Step& y);

// b = Jᵀ r.
Step negative_gradient(const NormalEquations& normal);
// The entries of D, in the shape of a step.
Step damping_entries(const NormalEquations& normal, DampingMatrix matrix);

// The metric of a diagonal matrix with positive entries.
double dot(const Step& a, const Step& metric, const Step& b);
double norm(const Step& x, const Step& metric);
// metric⁻¹ g
Step divide(const Step& g, const Step& metric);

}  // namespace sfmcpp::linear

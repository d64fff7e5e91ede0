// The algebraic reprojection error along a step (thesis §4.3, eqs 4.8–4.18; docs/equations.md §5).
//
// With q̂ the observation without distortion, normalised in its image, P the matrix to normalised
// pixels and S the first two rows of [q̂]×:
//   A = S P Q,  B_P = S ΔP Q,  B_Q = S P ΔQ,  C = S ΔP ΔQ,
// and the error at camera length x and point length y is A + x B_P + y B_Q + x y C. Thesis eqs 4.10
// and 4.14 weigh all observations alike. Its length is w times the distance in the image, w =
// (PQ)₃: weights 1/w² at the current state make the algebraic cost start as the geometric one.
// Divided by w, it is in the axes of the image: what whitens a residual whitens it.
#pragma once

#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/math/biquadratic.hpp"
#include "sfmcpp/residuals/reprojection.hpp"
#include "sfmcpp/residuals/whitening.hpp"

namespace sfmcpp::residuals {

// Newton steps by which a lens is undone: the proposed length needs no more.
inline constexpr int kLensSteps = 2;

// Observations of one camera (with `inverse_sigma` its weights), and where a step would take them.
struct AlgebraicBatch {
  ObservationBatch observations;
  const double* matrix;              // 3×4, to normalised pixels, row-major
  const double* change;              // its change along the step
  const double* point_steps;         // N × 3, in the tangents of all points
  double centre_u, centre_v, scale;  // of the normalisation: (u − centre_u) / scale
  bool weigh_by_depth;
  WhitenerShapes shapes{};  // beside the weights
};

// The nine sums in the order of Biquadratic, and what is rounded off of them.
inline constexpr int kAlgebraicSums = sizeof(Biquadratic) / sizeof(double);
struct AlgebraicSums {
  double sums[kAlgebraicSums];
  double rests[kAlgebraicSums];
};

struct AlgebraicKernel {
  AlgebraicSums (*sums)(const AlgebraicBatch&);
};

AlgebraicKernel algebraic_kernel(const CameraModel& model);
SFMCPP_DECLARE_FOR_EACH_ISA(AlgebraicKernel algebraic_kernel_for(CameraModelId model))

}  // namespace sfmcpp::residuals

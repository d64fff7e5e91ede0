// Observations with a covariance Σ (thesis eqs 1.17–1.18; docs/equations.md §1): the residual is
// L (observed − projected) with LᵀL = Σ⁻¹, so that its covariance is the identity, and
//
//   L = 1/σ_u [ 1  0 ; shear  stretch ],
//
// the inverse of the Cholesky factor of Σ. Of all factors of Σ⁻¹, which differ by a rotation of the
// residual and give the same cost, it needs fewest numbers and no eigenvalues; and where Σ = σ²I it
// is 1/σ to the last bit: shear is 0 and stretch 1.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "sfmcpp/residuals/reprojection.hpp"

namespace sfmcpp::residuals {

struct Whitener {
  double inverse_sigma = 1.0;  // 1/σ_u
  double shear = 0.0;
  double stretch = 1.0;  // σ_u over the standard deviation of v where u is known
};

// Of 2×2 numbers, symmetric.
Whitener whitener_of(const double* covariance);
// Of observation k: by σ (M) or Σ (M × 2 × 2), one of which is empty, or of 1 px if both are.
Whitener whitener_of(std::span<const double> sigma_px,
                     std::span<const double> covariance_px2,
                     std::size_t k);
// Throws InvalidArgument that names the first of `count` covariances that is none: finite,
// symmetric and positive definite, both beyond rounding. There may be none at all, and no σ beside
// them.
void check_covariances(std::span<const double> sigma_px,
                       std::span<const double> covariance_px2,
                       std::size_t count);

// Of consecutive observations, what their whiteners have beyond 1/σ_u; null where all Σ = σ²I.
struct WhitenerShapes {
  const double* shear = nullptr;
  const double* stretch = nullptr;
};

// Whiteners as arrays, of the observations of a problem in any order.
struct Whiteners {
  Whiteners() = default;
  // Observation i is `source[i]` of the caller's; the arrays are readable `ahead` numbers further.
  Whiteners(std::span<const double> sigma_px,
            std::span<const double> covariance_px2,
            std::span<const int> source,
            int ahead);

  WhitenerShapes shapes_from(std::ptrdiff_t first) const;

  std::vector<double> inverse_sigma;
  std::vector<double> shear, stretch;  // empty where all Σ = σ²I
};

// What the kernels computed with 1/σ_u alone, turned into what L gives: residuals, or their
// Jacobian, of `count` observations.
void whiten(const WhitenerShapes& shapes, int count, const double* ru, double* rv);
void whiten(const WhitenerShapes& shapes, int count, const JacobianOutput& jacobian);

}  // namespace sfmcpp::residuals

// A cost that is quadratic in each of two step lengths: what the algebraic reprojection error is
// along a step (thesis eqs 4.10, 4.14).
//
// With residual A + x B_P + y B_Q + x y C for camera length x and point length y,
//   F(x, y) = ½ Σ ‖A + x B_P + y B_Q + x y C‖²
// needs nine sums over the observations and nothing else.
#pragma once

#include <array>
#include <vector>

namespace sfmcpp {

struct Biquadratic {
  double aa = 0.0;  // Σ A·A
  double ap = 0.0;  // Σ A·B_P              (b₂ of thesis eq. 4.18)
  double aq = 0.0;  // Σ A·B_Q              (a₂)
  double pp = 0.0;  // Σ B_P·B_P            (h₂)
  double qq = 0.0;  // Σ B_Q·B_Q            (g₂)
  double pq = 0.0;  // Σ B_P·B_Q + A·C      (c₂)
  double pc = 0.0;  // Σ B_P·C              (d₂)
  double qc = 0.0;  // Σ B_Q·C              (e₂)
  double cc = 0.0;  // Σ C·C                (f₂)

  double value(double x, double y) const;
  std::array<double, 2> gradient(double x, double y) const;

  // Where dF/dα = 0 on the diagonal x = y = α: the real roots of a α³ + b α² + c α + d with a = 2
  // C·C, b = 3 B·C, c = 2 A·C + B·B, d = A·B, B = B_P + B_Q. (Thesis eqs 4.11 and 4.13 lack the
  // factor 2 of A·C.) Ascending.
  std::vector<double> stationary_lengths() const;

  // Where both partial derivatives vanish: x a real root of the quintic Υ below thesis eq. 4.19, y
  // from eq. 4.19, polished by Newton steps on the gradient. Ascending in x. The minimum is among
  // them, unless it lies where B_Q + x C all but vanishes, so that y is arbitrary or huge. A length
  // that changes nothing (pp = cc = 0: no step of the cameras; qq = cc = 0: none of the points) is
  // 1. None if a sum is not finite.
  std::vector<std::array<double, 2>> stationary_pairs() const;
};

}  // namespace sfmcpp

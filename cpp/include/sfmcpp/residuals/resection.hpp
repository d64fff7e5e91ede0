// Fixed points seen by one metric camera whose pose is sought: r = (observed − projected) / σ, or
// whitened by a covariance (whitening.hpp), and the sums of the 6×6 normal equations of the pose,
// for any lens and instruction set.
#pragma once

#include <span>

#include "sfmcpp/cameras/camera_model.hpp"
#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/residuals/whitening.hpp"

namespace sfmcpp::residuals {

// What the kernels read: n points and their images, each coordinate an array of `padded` numbers.
struct ViewArrays {
  const double *x, *y, *z;  // world
  const double *u, *v;      // pixels
  const double* inverse_sigma;
  int count, padded;
  WhitenerShapes shapes{};
};

// Owns them: padded to whole packs with copies of the first observation of weight zero.
class PointViews {
 public:
  // `points` n × 3 in the world, `pixels` n × 2, `sigma_px` n or `covariance_px2` n × 2 × 2, or
  // neither for 1 px; n at least 1.
  PointViews(std::span<const double> points,
             std::span<const double> pixels,
             std::span<const double> sigma_px,
             std::span<const double> covariance_px2 = {});

  ViewArrays arrays() const;

 private:
  int count_;
  int padded_;
  AlignedVector<double> values_;  // 6 × padded
  Whiteners whiteners_;           // padded; with the weights of the padding
};

// Σ JᵀJ (lower triangle, row by row), Σ Jᵀr with J = ∂projected/∂(δR, δt) / σ, whitened like r, and
// Σ ‖r‖².
struct PoseSums {
  static constexpr int kNormal = 21, kGradient = 6;
  double normal[kNormal];
  double gradient[kGradient];
  double cost;
};

// What each observation contributes, in 14 arrays of `padded` numbers: rows (u, v) of J, then r.
inline constexpr int kViewRows = 14;

struct ResectionKernels {
  // `inverse_sigma`, padded, stands in for that of the views: zero leaves an observation out.
  void (*sums)(const ViewArrays&,
               const double* intrinsics,
               const double* pose,
               const double* inverse_sigma,
               PoseSums&);
  // The same against the images that another pose has of the points instead of those observed: the
  // sums of a reprojection constraint with e = −r. With `same_centre` the other moves along with t.
  void (*sums_between)(const ViewArrays&,
                       const double* intrinsics,
                       const double* pose,
                       const double* other,
                       bool same_centre,
                       PoseSums&);
  void (*rows)(const ViewArrays&, const double* intrinsics, const double* pose, double* rows);
  // ‖r‖² of each observation, `padded` numbers; infinite for points not in front of the camera.
  // With views that lack shapes, the squared distance in the image over σ_u².
  void (*squared_errors)(const ViewArrays&,
                         const double* intrinsics,
                         const double* pose,
                         double* errors);
  // ‖(I − J N Jᵀ)⁻¹ (r − J s)‖² of each observation, with N = WᵀW: the error with which a linear
  // fit to all others predicts it (Allen's PRESS). W lower triangular, 21 numbers; s a shift of the
  // pose; `rows` as above.
  void (*predicted_errors)(
      const double* rows, int padded, const double* whitener, const double* shift, double* errors);
};

// Throws InvalidArgument for a model without poses.
ResectionKernels resection_kernels(CameraModelId model);
SFMCPP_DECLARE_FOR_EACH_ISA(ResectionKernels resection_kernels_for(CameraModelId model))

}  // namespace sfmcpp::residuals

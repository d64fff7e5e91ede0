// How the projections of the observations of one camera bend along a step: the second derivative of
// α ↦ projection(x ⊞ α δ) at α = 0, times the weight of the residual. Exact, by jets (math/jet.hpp)
// through the camera models.
#pragma once

#include "sfmcpp/residuals/reprojection.hpp"

namespace sfmcpp::residuals {

struct BendingBatch {
  ObservationBatch observations;  // of one camera, with `inverse_sigma` their weights
  const double* camera_step;      // in the tangent of the camera
  const double* camera_bend;      // second derivatives of its turn and centre, in its axes: 6
  const double* intrinsics_step;  // for each stored intrinsic parameter, zero where it is fixed
  const double* point_steps;      // N × 3, in the tangents of all points
};

struct BendingKernel {
  // Into u, v, each with room for count + kReadAhead numbers.
  void (*bend)(const BendingBatch&, double* u, double* v);
};

BendingKernel bending_kernel(const CameraModel& model);

}  // namespace sfmcpp::residuals

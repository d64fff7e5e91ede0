// What the kernels compute of compiled camera models, of one that is a function (CameraFunction):
// all observations of a pass have their images in one call, and residuals and Jacobians are made of
// these. No point is behind such a camera: its function decides what it sees.
#pragma once

#include <vector>

#include "sfmcpp/cameras/camera_function.hpp"
#include "sfmcpp/residuals/reprojection.hpp"

namespace sfmcpp::residuals {

class FunctionImages {
 public:
  // `function` must outlive this object.
  FunctionImages(const CameraFunction& function, int count);

  int count() const { return count_; }
  // The observations of a batch are those from `first` on.
  void set(int first, const ObservationBatch& batch);
  // The same where a step has gone the share `length` of its way, to second order in it.
  void set_along(int first, const BendingBatch& batch, double length);
  // The call, for all observations that were set.
  void evaluate(bool with_jacobians);

  // Of a batch as it was set, like ReprojectionKernels.
  void residuals(int first, const ObservationBatch& batch, double* ru, double* rv) const;
  void linearize(int first, const ObservationBatch& batch, const JacobianOutput& out) const;
  const double* pixel(int k) const { return pixels_.data() + 2L * k; }

 private:
  double* point(int k) { return points_.data() + 3L * k; }
  double* intrinsics(int k) { return intrinsics_.data() + static_cast<long>(num_intrinsics_) * k; }

  const CameraFunction& function_;
  int num_intrinsics_;
  int count_;
  std::vector<double> points_, intrinsics_, pixels_;  // points in the frame of their camera
  std::vector<double> by_point_, by_intrinsics_;
};

}  // namespace sfmcpp::residuals

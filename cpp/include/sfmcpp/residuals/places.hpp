// Reprojection residuals of points at places that are tried for them, and their derivatives by the
// place: observations of any cameras in any order, for the camera model and instruction set chosen
// at run time.
#pragma once

#include "sfmcpp/cameras/camera_model.hpp"

namespace sfmcpp::residuals {

// Indices must be readable and in range, and numbers readable, kReadAhead beyond the end.
struct PlaceBatch {
  const double* cameras;  // 12 numbers each
  const int* camera;      // of each observation
  const double* intrinsics;
  const int* intrinsics_row;
  const double* places;
  const int* place;
  const double* u;  // observed pixels
  const double* v;
  const double* inverse_sigma;
  int count;
};

struct PlaceKernel {
  // Records of eight numbers (JacobianOutput::point).
  void (*linearize)(const PlaceBatch&, double* records);
};

PlaceKernel place_kernel(const CameraModel& model);

}  // namespace sfmcpp::residuals

// From the name of a camera model to its type, with the double-typed templates as the reference.
#pragma once

#include "sfmcpp/cameras/bal.hpp"
#include "sfmcpp/cameras/calibrated.hpp"
#include "sfmcpp/cameras/camera_model.hpp"
#include "sfmcpp/cameras/perspective.hpp"

namespace sfmcpp::support {

// f(camera) with an empty object of the model's type.
template <class F>
auto visit_camera(CameraModelId model, const F& f) {
  switch (model) {
    case CameraModelId::kPerspective:
      return f(PerspectiveCamera{});
    case CameraModelId::kBal:
      return f(BalCamera{});
    case CameraModelId::kCalibrated:
      break;
  }
  return f(CalibratedCamera{});
}

inline ImagePoint<double> project(CameraModelId model,
                                  const double* camera,
                                  const double* intrinsics,
                                  const double* point) {
  return visit_camera(model, [&](auto type) {
    return decltype(type)::template project<double>(camera, intrinsics, point);
  });
}

}  // namespace sfmcpp::support

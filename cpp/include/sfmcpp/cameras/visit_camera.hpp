// The registry of the camera models: from the name of a model to its type.
#pragma once

#include "sfmcpp/cameras/bal.hpp"
#include "sfmcpp/cameras/calibrated.hpp"
#include "sfmcpp/cameras/camera_model.hpp"
#include "sfmcpp/cameras/perspective.hpp"
#include "sfmcpp/cameras/projective.hpp"
#ifdef SFMCPP_CAMERA_PLUGIN
#include SFMCPP_CAMERA_PLUGIN
#endif

namespace sfmcpp {

// Calls f with a value of the camera's type, and returns what it returns.
template <class F>
decltype(auto) visit_camera(CameraModelId model, const F& f) {
  switch (model) {
    case CameraModelId::kPerspective:
      return f(PerspectiveCamera{});
    case CameraModelId::kBal:
      return f(BalCamera{});
    case CameraModelId::kProjective:
      return f(ProjectiveCamera{});
    case CameraModelId::kPlugin:
#ifdef SFMCPP_CAMERA_PLUGIN
      static_assert(PluginCamera::kIntrinsics <= 12, "a camera has no room for more columns");
      return f(PluginCamera{});
#endif
    case CameraModelId::kCalibrated:
      break;
  }
  return f(CalibratedCamera{});
}

// Throws InvalidArgument if the model is a function.
template <class F>
decltype(auto) visit_camera(const CameraModel& model, const F& f) {
  return visit_camera(model.compiled(), f);
}

// The same for code that needs no images, only cameras, points and their updates: any model,
// functions too.
template <class F>
decltype(auto) visit_space(const CameraModel& model, const F& f) {
  if (model.function() != nullptr) return f(MetricSpace{});
  return visit_camera(model, f);
}

}  // namespace sfmcpp

// From the name of a camera model to its type: the registry of the camera models.
#pragma once

#include "sfmcpp/cameras/bal.hpp"
#include "sfmcpp/cameras/calibrated.hpp"
#include "sfmcpp/cameras/camera_model.hpp"
#include "sfmcpp/cameras/perspective.hpp"
#include "sfmcpp/cameras/projective.hpp"

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
    case CameraModelId::kCalibrated:
      break;
  }
  return f(CalibratedCamera{});
}

}  // namespace sfmcpp

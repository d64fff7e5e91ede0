// The double-typed camera templates, the reference of every kernel, by the name of the model.
#pragma once

#include "sfmcpp/cameras/visit_camera.hpp"

namespace sfmcpp::support {

inline ImagePoint<double> project(CameraModelId model,
                                  const double* camera,
                                  const double* intrinsics,
                                  const double* point) {
  return visit_camera(model, [&](auto type) {
    return decltype(type)::template project<double>(camera, intrinsics, point);
  });
}

}  // namespace sfmcpp::support

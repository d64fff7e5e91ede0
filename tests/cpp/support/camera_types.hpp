// The camera models as types, for typed tests; add a model to `CameraTypes` and it is tested.
#pragma once

#include <string>

#include <gtest/gtest.h>

#include "sfmcpp/cameras/visit_camera.hpp"

namespace sfmcpp::support {

template <class CameraType, CameraModelId kModel>
struct CameraOf {
  using Camera = CameraType;
  static constexpr CameraModelId kId = kModel;
};

using MetricCameraTypes = testing::Types<CameraOf<CalibratedCamera, CameraModelId::kCalibrated>,
                                         CameraOf<PerspectiveCamera, CameraModelId::kPerspective>,
                                         CameraOf<BalCamera, CameraModelId::kBal>>;

using CameraTypes = testing::Types<CameraOf<CalibratedCamera, CameraModelId::kCalibrated>,
                                   CameraOf<PerspectiveCamera, CameraModelId::kPerspective>,
                                   CameraOf<BalCamera, CameraModelId::kBal>,
                                   CameraOf<ProjectiveCamera, CameraModelId::kProjective>>;

struct CameraTypeName {
  template <class T>
  static std::string GetName(int) {
    return std::string(enum_name(T::kId));
  }
};

}  // namespace sfmcpp::support

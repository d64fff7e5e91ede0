// The camera models as types, for typed tests.
#pragma once

#include <cstddef>
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

template <class... Cameras>
struct CameraList {
  static constexpr std::size_t kCount = sizeof...(Cameras);
  using Types = testing::Types<Cameras...>;
};

using AllCameras = CameraList<CameraOf<CalibratedCamera, CameraModelId::kCalibrated>,
                              CameraOf<PerspectiveCamera, CameraModelId::kPerspective>,
                              CameraOf<BalCamera, CameraModelId::kBal>,
                              CameraOf<ProjectiveCamera, CameraModelId::kProjective>>;
static_assert(AllCameras::kCount == EnumNames<CameraModelId>::kTable.size(), "a model is missing");

using CameraTypes = AllCameras::Types;

struct CameraTypeName {
  template <class T>
  static std::string GetName(int) {
    return std::string(enum_name(T::kId));
  }
};

}  // namespace sfmcpp::support

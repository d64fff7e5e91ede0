// The camera models as types, for typed tests.
#pragma once

#include <cstddef>
#include <string>

#include <gtest/gtest.h>

#include "sfmcpp/cameras/visit_camera.hpp"
#include "support/function_camera.hpp"

namespace sfmcpp::support {

template <class CameraType, CameraModelId kModel>
struct CameraOf {
  using Camera = CameraType;
  static constexpr CameraModelId kId = kModel;
  static std::string name() { return std::string(enum_name(kModel)); }
};

// A function that images as a compiled model does.
struct PerspectiveFunction
    : CameraOf<FunctionCamera<PerspectiveLens>, CameraModelId::kPerspective> {
  static std::string name() { return "function"; }
};

using MetricCameraTypes = testing::Types<CameraOf<CalibratedCamera, CameraModelId::kCalibrated>,
                                         CameraOf<PerspectiveCamera, CameraModelId::kPerspective>,
                                         CameraOf<BalCamera, CameraModelId::kBal>,
#ifdef SFMCPP_CAMERA_PLUGIN
                                         CameraOf<PluginCamera, CameraModelId::kPlugin>,
#endif
                                         PerspectiveFunction>;

template <class... Cameras>
struct CameraList {
  static constexpr std::size_t kCount = sizeof...(Cameras);
  using Types = testing::Types<Cameras...>;
  template <class... More>
  using With = testing::Types<Cameras..., More...>;
};

using AllCameras = CameraList<CameraOf<CalibratedCamera, CameraModelId::kCalibrated>,
                              CameraOf<PerspectiveCamera, CameraModelId::kPerspective>,
                              CameraOf<BalCamera, CameraModelId::kBal>,
#ifdef SFMCPP_CAMERA_PLUGIN
                              CameraOf<PluginCamera, CameraModelId::kPlugin>,
#endif
                              CameraOf<ProjectiveCamera, CameraModelId::kProjective>>;
static_assert(AllCameras::kCount == EnumNames<CameraModelId>::kTable.size(), "a model is missing");

using CameraTypes = AllCameras::Types;
using CameraAndFunctionTypes = AllCameras::With<PerspectiveFunction>;

struct CameraTypeName {
  template <class T>
  static std::string GetName(int) {
    return T::name();
  }
};

}  // namespace sfmcpp::support

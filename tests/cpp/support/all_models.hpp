// Every camera model that has a name, for tests with the model as their parameter.
#pragma once

#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "sfmcpp/cameras/camera_model.hpp"

namespace sfmcpp::support {

inline std::vector<CameraModelId> all_models() {
  std::vector<CameraModelId> models;
  for (const auto& [model, name] : EnumNames<CameraModelId>::kTable) models.push_back(model);
  return models;
}

inline std::vector<CameraModelId> metric_models() {
  std::vector<CameraModelId> models = all_models();
  std::erase_if(models, [](CameraModelId model) { return !is_metric(model); });
  return models;
}

inline std::string name_of_model(const testing::TestParamInfo<CameraModelId>& test) {
  return std::string(enum_name(test.param));
}

}  // namespace sfmcpp::support

#include "sfmcpp/cameras/camera_model.hpp"

#include "sfmcpp/cameras/visit_camera.hpp"
#include "sfmcpp/core/error.hpp"

namespace sfmcpp {

CameraModelId CameraModel::compiled() const {
  if (function_ == nullptr) return id_;
  throw InvalidArgument("camera_model = '" + function_->name() +
                        "': a function of images alone, must be a compiled model here");
}

std::string_view CameraModel::name() const {
  return function_ != nullptr ? function_->name() : enum_name(id_);
}

std::span<const std::string_view> intrinsic_names(const CameraModel& model) {
  if (model.function() != nullptr) return model.function()->intrinsic_names();
  return visit_camera(model, [](auto camera) -> std::span<const std::string_view> {
    return decltype(camera)::kIntrinsicNames;
  });
}

bool has_free_intrinsics(const CameraModel& model) {
  if (model.function() != nullptr) return true;
  return visit_camera(model.compiled(),
                      [](auto camera) { return decltype(camera)::kIntrinsics > 0; });
}

bool is_metric(const CameraModel& model) {
  return visit_space(model, [](auto space) { return decltype(space)::kMetric; });
}

int camera_tangent(const CameraModel& model) {
  return visit_space(model, [](auto space) { return decltype(space)::kTangent; });
}

int point_storage(const CameraModel& model) {
  return visit_space(model, [](auto space) { return decltype(space)::kPointStorage; });
}

void plus_camera(const CameraModel& model,
                 const double* camera,
                 const double* delta,
                 double* result) {
  visit_space(model, [&](auto space) { decltype(space)::plus(camera, delta, result); });
}

void plus_point(const CameraModel& model,
                const double* point,
                const double* delta,
                double* result) {
  visit_space(model, [&](auto space) { decltype(space)::plus_point(point, delta, result); });
}

void normalize_camera(const CameraModel& model, double* camera) {
  visit_space(model, [&](auto space) { decltype(space)::normalize(camera); });
}

void normalize_point(const CameraModel& model, double* point) {
  visit_space(model, [&](auto space) { decltype(space)::normalize_point(point); });
}

}  // namespace sfmcpp

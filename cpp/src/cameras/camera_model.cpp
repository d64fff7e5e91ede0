#include "sfmcpp/cameras/camera_model.hpp"

#include "sfmcpp/cameras/visit_camera.hpp"

namespace sfmcpp {

std::span<const std::string_view> intrinsic_names(CameraModelId model) {
  return visit_camera(model, [](auto camera) -> std::span<const std::string_view> {
    return decltype(camera)::kIntrinsicNames;
  });
}

bool has_free_intrinsics(CameraModelId model) {
  return visit_camera(model, [](auto camera) { return decltype(camera)::kIntrinsics > 0; });
}

bool is_metric(CameraModelId model) {
  return visit_camera(model, [](auto camera) { return decltype(camera)::kMetric; });
}

int camera_tangent(CameraModelId model) {
  return visit_camera(model, [](auto camera) { return decltype(camera)::kTangent; });
}

int point_storage(CameraModelId model) {
  return visit_camera(model, [](auto camera) { return decltype(camera)::kPointStorage; });
}

void plus_camera(CameraModelId model, const double* camera, const double* delta, double* result) {
  visit_camera(model, [&](auto type) { decltype(type)::plus(camera, delta, result); });
}

void plus_point(CameraModelId model, const double* point, const double* delta, double* result) {
  visit_camera(model, [&](auto type) { decltype(type)::plus_point(point, delta, result); });
}

void normalize_camera(CameraModelId model, double* camera) {
  visit_camera(model, [&](auto type) { decltype(type)::normalize(camera); });
}

void normalize_point(CameraModelId model, double* point) {
  visit_camera(model, [&](auto type) { decltype(type)::normalize_point(point); });
}

}  // namespace sfmcpp

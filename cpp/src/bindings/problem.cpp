#include "problem.hpp"

#include <pybind11/stl.h>

#include "arrays.hpp"
#include "options.hpp"

namespace sfmcpp::bindings {
namespace {

std::span<const std::uint8_t> flags(const py::dict& arrays, const char* name) {
  const std::span<const bool> values = view<const bool>(arrays, name);
  static_assert(sizeof(bool) == sizeof(std::uint8_t));
  return {reinterpret_cast<const std::uint8_t*>(values.data()), values.size()};
}

}  // namespace

ba::Problem problem_of(const py::dict& arrays) {
  ba::Problem problem;
  problem.camera_model = parse_enum<CameraModelId>(arrays["camera_model"].cast<std::string>());
  problem.cameras = view<const double>(arrays, "cameras");
  problem.intrinsics = view<const double>(arrays, "intrinsics");
  problem.points = view<const double>(arrays, "points");
  problem.intrinsics_index = view<const int>(arrays, "intrinsics_index");
  problem.camera_index = view<const int>(arrays, "camera_index");
  problem.point_index = view<const int>(arrays, "point_index");
  problem.pixels = view<const double>(arrays, "pixels");
  if (!arrays["sigma_px"].is_none()) problem.sigma_px = view<const double>(arrays, "sigma_px");
  if (!arrays["covariance_px2"].is_none())
    problem.covariance_px2 = view<const double>(arrays, "covariance_px2");
  if (arrays.contains("rig_sensors")) {
    problem.rigs = {.sensors = view<const double>(arrays, "rig_sensors"),
                    .frame_of_camera = view<const int>(arrays, "frame_of_camera"),
                    .sensor_of_camera = view<const int>(arrays, "sensor_of_camera")};
  }
  problem.fixed_cameras = flags(arrays, "fixed_cameras");
  problem.fixed_points = flags(arrays, "fixed_points");
  problem.fixed_intrinsics = flags(arrays, "fixed_intrinsics");
  return problem;
}

void bind_camera_models(py::module_& m) {
  struct CameraModel {
    std::string_view name;
    std::vector<std::string_view> intrinsics;
    bool can_be_free, metric;
  };
  py::class_<CameraModel>(m, "CoreCameraModel", "What the core knows of a camera model.")
      .def_readonly("name", &CameraModel::name)
      .def_readonly("intrinsics", &CameraModel::intrinsics, "Names, in the order they are stored.")
      .def_readonly("can_be_free", &CameraModel::can_be_free, "Whether any of them may be free.")
      .def_readonly("metric", &CameraModel::metric, "Whether its cameras are poses [R | c].");
  py::list models;
  for (const auto& [model, name] : EnumNames<CameraModelId>::kTable) {
    const auto names = intrinsic_names(model);
    models.append(py::cast(CameraModel{
        name, {names.begin(), names.end()}, has_free_intrinsics(model), is_metric(model)}));
  }
  m.attr("CAMERA_MODELS") = py::tuple(models);
}

}  // namespace sfmcpp::bindings

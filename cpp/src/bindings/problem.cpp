#include <limits>

#include <pybind11/stl.h>

#include "arguments.hpp"
#include "module.hpp"
#include "python_function.hpp"
#include "sfmcpp/residuals/constraint_set.hpp"

namespace sfmcpp::bindings {
namespace {

std::span<const std::uint8_t> flags(const py::dict& arrays, const char* name) {
  const std::span<const bool> values = view<const bool>(arrays, name);
  static_assert(sizeof(bool) == sizeof(std::uint8_t));
  return {reinterpret_cast<const std::uint8_t*>(values.data()), values.size()};
}

// `function(points, intrinsics, wanted)` gives pixels (n, 2) and, where they are wanted, their
// derivatives by points (n, 2, 3) and by intrinsics (n, 2, K); Python has checked the shapes.
class PythonCamera : public CameraFunction, public PythonFunction {
 public:
  PythonCamera(std::string name, std::vector<std::string> intrinsics, py::object function)
      : PythonFunction(std::move(function)),
        name_(std::move(name)),
        intrinsics_(std::move(intrinsics)),
        names_(intrinsics_.begin(), intrinsics_.end()) {}

  const std::string& name() const override { return name_; }
  std::span<const std::string_view> intrinsic_names() const override { return names_; }

  void image(int count,
             const double* points,
             const double* intrinsics,
             double* pixels,
             const Jacobians* jacobians) const override {
    const auto width = static_cast<py::ssize_t>(names_.size());
    const auto arguments = [&] {
      return py::make_tuple(
          array(count, 3, points), array(count, width, intrinsics), jacobians != nullptr);
    };
    const long numbers = 2L * count;
    const auto take = [&](const py::tuple& answer) {
      copy_answer(answer[0], numbers, pixels);
      if (jacobians == nullptr) return;
      copy_answer(answer[1], 3 * numbers, jacobians->by_point);
      copy_answer(answer[2], width * numbers, jacobians->by_intrinsics);
    };
    if (call(arguments, take)) return;
    constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();
    std::fill_n(pixels, numbers, kNoNumber);
    if (jacobians == nullptr) return;
    std::fill_n(jacobians->by_point, 3 * numbers, kNoNumber);
    std::fill_n(jacobians->by_intrinsics, width * numbers, kNoNumber);
  }

 private:
  static py::array_t<double> array(int rows, py::ssize_t columns, const double* values) {
    return py::array_t<double>(std::vector<py::ssize_t>{rows, columns}, values);
  }

  std::string name_;
  std::vector<std::string> intrinsics_;
  std::vector<std::string_view> names_;
};

CameraModel camera_model_of(const py::object& model) {
  if (py::isinstance<PythonCamera>(model)) return CameraModel(model.cast<const PythonCamera&>());
  return parse_enum<CameraModelId>(model.cast<std::string>());
}

void rethrow(const PythonFunction* function) {
  if (function != nullptr && function->failure()) std::rethrow_exception(function->failure());
}

}  // namespace

void rethrow_failures(const ba::Problem& problem) {
  rethrow(dynamic_cast<const PythonCamera*>(problem.camera_model.function()));
  if (problem.constraints == nullptr) return;
  for (const residuals::ConstraintGroup& group : problem.constraints->groups())
    rethrow(dynamic_cast<const PythonFunction*>(group.function.get()));
}

ba::Problem problem_of(const py::dict& arrays) {
  ba::Problem problem;
  problem.camera_model = camera_model_of(arrays["camera_model"]);
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
                    .sensor_of_camera = view<const int>(arrays, "sensor_of_camera"),
                    .free_sensors = flags(arrays, "free_sensors")};
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
  py::class_<PythonCamera>(m, "CoreCameraFunction", "A camera model by a Python function.")
      .def(py::init<std::string, std::vector<std::string>, py::object>(),
           py::arg("name"),
           py::arg("intrinsics"),
           py::arg("function"));
  py::list models;
  for (const auto& [model, name] : EnumNames<CameraModelId>::kTable) {
    const auto names = intrinsic_names(model);
    models.append(py::cast(CameraModel{
        name, {names.begin(), names.end()}, has_free_intrinsics(model), is_metric(model)}));
  }
  m.attr("CAMERA_MODELS") = py::tuple(models);
}

}  // namespace sfmcpp::bindings

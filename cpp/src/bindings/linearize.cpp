#include <mutex>

#include <pybind11/eigen.h>
#include <pybind11/stl.h>

#include "arguments.hpp"
#include "arrays.hpp"
#include "module.hpp"
#include "python_function.hpp"
#include "sfmcpp/ba/constraint_terms.hpp"
#include "sfmcpp/ba/linear_model.hpp"

namespace sfmcpp::bindings {
namespace {

// What is asked of a model is computed where it is first asked for, and kept: one thread at a time.
class LinearModel : public ba::LinearModel {
 public:
  using ba::LinearModel::LinearModel;

  // The value of f(), with the GIL released, in turn with other threads.
  template <class F>
  auto in_turn(const F& f) {
    const ReleasedGil released;
    const std::lock_guard<std::mutex> turn(mutex_);
    return f();
  }

 private:
  std::mutex mutex_;
};

using Shape = std::vector<py::ssize_t>;

// An array that `fill` writes.
template <class T, class F>
py::array_t<T> filled(const Shape& shape, const F& fill) {
  py::array_t<T> result(shape);
  fill(result.mutable_data());
  return result;
}

std::unique_ptr<LinearModel> linearize(const py::dict& arrays,
                                       const ba::SolveOptions& options,
                                       double ridge,
                                       const std::string& datum) {
  const auto chosen = parse_enum<ba::Datum>(datum);
  const KeptArrays kept(arrays);
  ba::Problem problem = problem_of(arrays);
  const residuals::ConstraintSet constraints = constraints_of(arrays, problem);
  problem.constraints = &constraints;
  return or_failures_of(problem, [&] {
    const ReleasedGil released;
    return std::make_unique<LinearModel>(problem, options, ridge, chosen);
  });
}

py::tuple jacobian(const LinearModel& model) {
  const py::ssize_t count = model.num_observations();
  py::array_t<double> camera(Shape{count, 2, model.camera_size()}), point(Shape{count, 2, 3});
  model.jacobian(camera.mutable_data(), point.mutable_data());
  return py::make_tuple(camera, point);
}

py::list groups(const LinearModel& model) {
  py::list result;
  for (const ba::ConstraintRows& group : model.groups()) {
    py::dict rows;
    rows["name"] = group.name;
    rows["weight"] = group.weight;
    rows["member"] = array_of(group.member);
    rows["errors"] = group.errors;
    rows["columns"] = group.jacobian.cols();
    const auto entries = static_cast<py::ssize_t>(group.jacobian.nonZeros());
    rows["data"] = py::array_t<double>(entries, group.jacobian.valuePtr());
    rows["indices"] = py::array_t<int>(entries, group.jacobian.innerIndexPtr());
    rows["indptr"] = py::array_t<int>(static_cast<py::ssize_t>(group.jacobian.rows()) + 1,
                                      group.jacobian.outerIndexPtr());
    result.append(rows);
  }
  return result;
}

py::array_t<double> covariance_blocks(LinearModel& model,
                                      const py::array_t<int, py::array::c_style>& columns) {
  const py::ssize_t count = columns.shape(0), width = columns.shape(1);
  const std::span<const int> chosen(columns.data(), static_cast<std::size_t>(columns.size()));
  return filled<double>({count, width, width}, [&](double* out) {
    model.in_turn([&] { model.covariance_blocks(chosen, static_cast<int>(width), out); });
  });
}

py::array_t<double> leverages(LinearModel& model) {
  return filled<double>({model.num_observations(), 2, 2},
                        [&](double* out) { model.in_turn([&] { model.leverages(out); }); });
}

py::dict step(LinearModel& model) {
  const ba::LinearStep step = model.in_turn([&] { return model.step(); });
  py::dict result;
  result["cameras"] = array_of(step.state.cameras);
  result["intrinsics"] = array_of(step.state.intrinsics);
  result["points"] = array_of(step.state.points);
  result["rig_sensors"] = array_of(step.state.sensors);
  result["errors"] = step.errors;
  result["decrease"] = step.decrease;
  return result;
}

// Of each group, at the present state.
std::vector<double> constraint_costs(const py::dict& arrays) {
  ba::Problem problem = problem_of(arrays);
  const residuals::ConstraintSet constraints = constraints_of(arrays, problem);
  problem.constraints = &constraints;
  const optim::State state = ba::state_of(problem);
  constraints.check(ba::constrained_cameras(problem, state));
  return or_failures_of(problem,
                        [&] { return constraints.costs(ba::constrained_cameras(problem, state)); });
}

void def_state(py::class_<LinearModel>& c) {
  c.def(py::init(&linearize),
        py::arg("arrays"),
        py::arg("options"),
        py::arg("ridge") = 0.0,
        py::arg("datum") = "cameras",
        py::keep_alive<1, 2>())
      .def_property_readonly("cost", &LinearModel::cost)
      .def_property_readonly("loss_scale_px", &LinearModel::loss_scale)
      .def_property_readonly("num_columns", &LinearModel::num_columns)
      .def_property_readonly("num_camera_columns", &LinearModel::num_camera_columns)
      .def_property_readonly("free_intrinsics", &LinearModel::free_intrinsics)
      .def_property_readonly("camera_columns",
                             [](const LinearModel& model) {
                               return filled<int>({model.num_cameras(), model.camera_size()},
                                                  [&](int* out) { model.camera_columns(out); });
                             })
      .def_property_readonly("point_columns",
                             [](const LinearModel& model) {
                               return filled<int>({model.num_points()},
                                                  [&](int* out) { model.point_columns(out); });
                             })
      .def_property_readonly("residuals",
                             [](const LinearModel& model) {
                               return filled<double>({model.num_observations(), 2},
                                                     [&](double* out) { model.residuals(out); });
                             })
      .def_property_readonly("observation_weights",
                             [](const LinearModel& model) {
                               return filled<double>({model.num_observations()}, [&](double* out) {
                                 model.observation_weights(out);
                               });
                             })
      .def("jacobian", &jacobian, "By the camera and by the point of each observation.")
      .def("groups", &groups, "Rows of each constraint group, without its weight.");
}

void def_statistics(py::class_<LinearModel>& c) {
  c.def("num_determined",
        [](LinearModel& model) { return model.in_turn([&] { return model.num_determined(); }); })
      .def(
          "log_determinant",
          [](LinearModel& model) { return model.in_turn([&] { return model.log_determinant(); }); })
      .def(
          "covariance",
          [](LinearModel& model, const std::vector<int>& columns) {
            return model.in_turn([&] { return model.covariance(columns); });
          },
          py::arg("columns"))
      .def("covariance_blocks", &covariance_blocks, py::arg("columns"))
      .def("leverages", &leverages)
      .def(
          "hat",
          [](LinearModel& model, int group) {
            return model.in_turn([&] { return Eigen::MatrixXd(model.hat(group)); });
          },
          py::arg("group"))
      .def(
          "hat_spectrum",
          [](LinearModel& model, int group) {
            const Spectrum spectrum = model.in_turn([&] { return model.hat_spectrum(group); });
            return py::make_tuple(spectrum.values, spectrum.vectors);
          },
          py::arg("group"))
      .def("step", &step, "The minimum of the linear model.");
}

// By its oldest protocols pickle makes an empty instance of pybind11's own base class, which ends
// the process.
[[noreturn]] py::tuple refuse_pickling(const LinearModel&, int) {
  throw py::type_error("a linear model cannot be pickled or copied: linearize the problem anew");
}

}  // namespace

void bind_linearize(py::module_& m) {
  py::class_<LinearModel> c(m, "CoreLinearModel", "The linear model of a problem at one state.");
  def_state(c);
  def_statistics(c);
  c.def("__reduce_ex__", &refuse_pickling, py::arg("protocol"));
  m.def("constraint_costs", &constraint_costs, py::arg("arrays"), "Weighted cost of each group.");
}

}  // namespace sfmcpp::bindings

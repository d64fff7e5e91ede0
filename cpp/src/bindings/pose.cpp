// Pose fits for weight selection: arrays in, arrays out.
#include <algorithm>

#include <pybind11/eigen.h>
#include <pybind11/stl.h>

#include "arrays.hpp"
#include "module.hpp"
#include "python_function.hpp"
#include "sfmcpp/ba/pose_refinement.hpp"

namespace sfmcpp::bindings {
namespace {

using ba::PoseView;
using ba::WeightedConstraint;
using Constraints = std::vector<WeightedConstraint>;

std::span<const double> sized(const py::dict& arrays, const char* name, std::size_t size) {
  const std::span<const double> values = view<const double>(arrays, name);
  if (values.size() != size) {
    throw InvalidArgument(std::string(name) + ": " + std::to_string(values.size()) +
                          " numbers, must be " + std::to_string(size));
  }
  return values;
}

PoseView view_of(const py::dict& arrays) {
  PoseView result;
  result.camera_model = parse_enum<CameraModelId>(arrays["camera_model"].cast<std::string>());
  result.intrinsics = view<const double>(arrays, "intrinsics");
  result.points = view<const double>(arrays, "points");
  result.pixels = view<const double>(arrays, "pixels");
  if (!arrays["sigma_px"].is_none()) result.sigma_px = view<const double>(arrays, "sigma_px");
  if (!arrays["covariance_px2"].is_none())
    result.covariance_px2 = view<const double>(arrays, "covariance_px2");
  return result;
}

WeightedConstraint constraint_of(const py::dict& arrays) {
  WeightedConstraint result;
  residuals::PoseConstraint& c = result.constraint;
  c.kind = parse_enum<residuals::ConstraintKind>(arrays["kind"].cast<std::string>());
  c.rotation =
      Eigen::Matrix<double, 3, 3, Eigen::RowMajor>::Map(sized(arrays, "rotation", 9).data());
  c.translation = Eigen::Vector3d::Map(sized(arrays, "translation", 3).data());
  c.distance = arrays["distance"].cast<double>();
  c.points = view<const double>(arrays, "points");
  std::ranges::copy(sized(arrays, "intrinsics", 5), c.intrinsics.begin());
  std::ranges::copy(sized(arrays, "previous", 12), result.previous.begin());
  result.weight = arrays["weight"].cast<double>();
  return result;
}

Constraints pose_constraints_of(const std::vector<py::dict>& dicts) {
  Constraints result;
  for (const py::dict& arrays : dicts) result.push_back(constraint_of(arrays));
  return result;
}

using Numbers = py::array_t<double, py::array::c_style>;

const double* pose_in(const Numbers& pose, const char* name) {
  if (pose.size() != 12) throw InvalidArgument(std::string(name) + ": must have shape (3, 4)");
  return pose.data();
}

py::array_t<double> poses_of(const std::vector<double>& numbers) {
  const auto count = static_cast<py::ssize_t>(numbers.size() / 12);
  return py::array_t<double>({count, py::ssize_t{3}, py::ssize_t{4}}, numbers.data());
}

py::dict to_dict(const ba::PoseSweep& sweep) {
  py::dict result;
  result["poses"] = poses_of(sweep.poses);
  result["vision"] = array_of(sweep.vision);
  result["held"] = array_of(sweep.held);
  result["constraint"] = array_of(sweep.constraint);
  result["constraint_slope"] = array_of(sweep.constraint_slope);
  result["leave_one_out"] = array_of(sweep.leave_one_out);
  result["approximate_leave_one_out"] = array_of(sweep.approximate_leave_one_out);
  result["inliers"] = array_of(sweep.inliers);
  result["converged"] = array_of(sweep.converged);
  return result;
}

py::dict sweep(const py::dict& arrays,
               const std::vector<py::dict>& constraint_dicts,
               int selected,
               const std::vector<double>& weights,
               const Numbers& start,
               const ba::PoseSweepOptions& options) {
  const KeptArrays kept(arrays, constraint_dicts, start);
  const PoseView pose_view = view_of(arrays);
  const Constraints constraints = pose_constraints_of(constraint_dicts);
  const double* from = pose_in(start, "start");
  ba::PoseSweep result;
  {
    const ReleasedGil released;
    result = ba::sweep_pose_weights(pose_view, constraints, selected, weights, from, options);
  }
  return to_dict(result);
}

py::dict refine(const py::dict& arrays,
                const std::vector<py::dict>& constraint_dicts,
                const Numbers& start,
                const ba::PoseSweepOptions& options) {
  const ba::PoseRefinement fit = ba::refine_pose(
      view_of(arrays), pose_constraints_of(constraint_dicts), pose_in(start, "start"), options);
  py::dict result;
  result["pose"] = py::array_t<double>({3, 4}, fit.pose.data());
  result["vision"] = fit.vision;
  result["constraints"] = array_of(fit.constraints);
  result["converged"] = fit.converged;
  return result;
}

py::dict linearize_fit(const py::dict& arrays,
                       const std::vector<py::dict>& constraint_dicts,
                       const Numbers& pose) {
  const ba::PoseLinearization at = ba::linearize_pose(
      view_of(arrays), pose_constraints_of(constraint_dicts), pose_in(pose, "pose"));
  py::dict result;
  result["vision_normal"] = at.vision_normal;
  result["vision_gradient"] = at.vision_gradient;
  result["vision"] = at.vision;
  result["residuals"] = at.residuals;
  result["jacobians"] = at.jacobians;
  return result;
}

void bind_options_of_sweep(py::module_& m) {
  using O = ba::PoseSweepOptions;
  py::class_<O>(m, "PoseSweepOptions", "Options of pose fits, with the defaults of the core.")
      .def(py::init<>())
      .def_readwrite("max_iterations", &O::max_iterations, "Steps of a fit at most.")
      .def_readwrite("fold_iterations", &O::fold_iterations, "Steps of a leave-one-out fold.")
      .def_readwrite("inlier_px", &O::inlier_px, "Largest error of an inlier [px].")
      .def_readwrite("leave_one_out", &O::leave_one_out, "Compute the exact score.")
      .def_readwrite("approximate_leave_one_out",
                     &O::approximate_leave_one_out,
                     "Compute the closed-form score.")
      .def_readwrite("threads", &O::threads, "Threads for the exact scores; 0: automatic.");
}

}  // namespace

void bind_pose(py::module_& m) {
  bind_options_of_sweep(m);
  m.def("sweep_pose_weights",
        &sweep,
        py::arg("view"),
        py::arg("constraints"),
        py::arg("selected"),
        py::arg("weights"),
        py::arg("start"),
        py::arg("options"),
        "One pose fit for each weight of the selected constraint; arrays by name.");
  m.def("refine_pose",
        &refine,
        py::arg("view"),
        py::arg("constraints"),
        py::arg("start"),
        py::arg("options"),
        "The pose fit with every constraint at its weight.");
  m.def("linearize_pose",
        &linearize_fit,
        py::arg("view"),
        py::arg("constraints"),
        py::arg("pose"),
        "Normal equations of the images, residuals and Jacobians of the constraints.");
}

}  // namespace sfmcpp::bindings

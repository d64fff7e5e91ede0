#pragma once

#include <pybind11/pybind11.h>

namespace sfmcpp::bindings {

namespace py = pybind11;

void bind_options(py::module_& m);
void bind_summary(py::module_& m);
void bind_exchange(py::module_& m);
void bind_solve(py::module_& m);
void bind_check(py::module_& m);
void bind_pose(py::module_& m);
void bind_constraint_kinds(py::module_& m);
void bind_losses(py::module_& m);
void bind_camera_models(py::module_& m);
void bind_linearize(py::module_& m);
void bind_nearest(py::module_& m);
void bind_patches(py::module_& m);
void bind_files(py::module_& m);

}  // namespace sfmcpp::bindings

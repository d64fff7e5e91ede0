#include "sfmcpp/ba/check.hpp"

#include <algorithm>
#include <iterator>

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include "arguments.hpp"
#include "arrays.hpp"
#include "module.hpp"
#include "python_function.hpp"
#include "sfmcpp/ba/check_jacobians.hpp"
#include "sfmcpp/ba/image_residuals.hpp"
#include "sfmcpp/ba/mask.hpp"
#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/ba/rigs.hpp"

namespace sfmcpp::bindings {
namespace {

linear::ObservationGraph checked_graph(const ba::Problem& problem) {
  ba::check_arrays(problem);
  ba::check_rigs(problem);
  linear::ObservationGraph graph = ba::graph_of(problem);
  ba::Frames(problem).hold_cameras(graph);
  ba::check_duplicates(problem, graph);
  return graph;
}

std::vector<std::string> check(const py::dict& arrays) {
  const ba::Problem problem = problem_of(arrays);
  const linear::ObservationGraph graph = checked_graph(problem);
  ba::check_determined(
      graph,
      ba::make_parameter_map(problem, graph, ba::free_intrinsics(problem, graph)),
      0,
      this_process(),
      [&] { return ba::num_world_freedoms(problem, graph, ba::state_of(problem)); });
  std::vector<std::string> warnings =
      ba::warnings_about(graph, problem.rigs, ba::anchors_of(problem));
  std::ranges::move(ba::warnings_about_baselines(problem, graph), std::back_inserter(warnings));
  std::ranges::move(ba::warnings_about_cameras(problem, graph), std::back_inserter(warnings));
  std::ranges::move(ba::FreeSensors(problem, graph).warnings(), std::back_inserter(warnings));
  return warnings;
}

// (M, 2) residuals over σ, in the caller's order.
py::array_t<double> residuals(const py::dict& arrays) {
  const ba::Problem problem = problem_of(arrays);
  ba::check_arrays(problem);
  const linear::ObservationGraph graph = ba::graph_of(problem);
  constexpr long kPassesOfASolve = 10;  // at least: a thread for one alone must find so much more
  const BorrowedPool borrowed(resolve_num_threads(0, problem.num_observations() / kPassesOfASolve));
  const std::vector<double> stored = or_failures_of(problem, [&] {
    return ba::ImageResiduals(problem, graph, *borrowed).values(ba::state_of(problem));
  });
  py::array_t<double> result({problem.num_observations(), 2});
  double* in_order = result.mutable_data();
  for (int k = 0; k < problem.num_observations(); ++k)
    std::copy_n(stored.data() + 2L * k, 2, in_order + 2L * graph.source[k]);
  return result;
}

// (M, 2) pixels as a lens without distortion would have seen them.
py::array_t<double> undistorted_pixels(const py::dict& arrays) {
  const ba::Problem problem = problem_of(arrays);
  ba::check_arrays(problem);
  py::array_t<double> result({problem.num_observations(), 2});
  ba::undistort_pixels(problem, result.mutable_data());
  return result;
}

// (C, 3, 4) matrices to pixels, distortion left out.
py::array_t<double> projection_matrices(const py::dict& arrays) {
  const ba::Problem problem = problem_of(arrays);
  ba::check_arrays(problem);
  py::array_t<double> result({problem.num_cameras(), 3, 4});
  ba::projection_matrices(problem, result.mutable_data());
  return result;
}

}  // namespace

void bind_check(py::module_& m) {
  m.attr("LEAST_FY") = ba::kLeastFy;
  using J = ba::JacobianCheck;
  py::class_<J>(
      m, "JacobianCheck", "Analytic against numeric derivatives; see sfmcpp.check_jacobians.")
      .def_readonly("entries", &J::entries, "Derivatives compared.")
      .def_readonly("worst_error", &J::worst_error, "Largest difference, relative to its block.")
      .def_readonly(
          "worst_observation", &J::worst_observation, "Observation of the largest difference.")
      .def_readonly("worst_parameter", &J::worst_parameter, "Parameter of the largest difference.")
      .def("__repr__",
           [](const J& j) {
             return py::
                 str("JacobianCheck({} derivatives, the worst off by {:.1e}: {} of observation {})")
                     .format(j.entries, j.worst_error, j.worst_parameter, j.worst_observation);
           })
      .def(py::pickle(
          [](const J& j) {
            return py::make_tuple(j.entries, j.worst_error, j.worst_observation, j.worst_parameter);
          },
          [](const py::tuple& state) {
            return J{state[0].cast<long>(),
                     state[1].cast<double>(),
                     state[2].cast<int>(),
                     state[3].cast<std::string>()};
          }));
  m.def("check",
        &check,
        py::arg("arrays"),
        "Raise for a broken problem; return what its owner should know.");
  m.def(
      "check_part",
      [](const py::dict& arrays) { checked_graph(problem_of(arrays)); },
      py::arg("arrays"),
      "Raise for broken arrays, which need not make a problem without those of others.");
  m.def("residuals",
        &residuals,
        py::arg("arrays"),
        "(M, 2) residuals over their standard deviation.");
  m.def("undistorted_pixels",
        &undistorted_pixels,
        py::arg("arrays"),
        "(M, 2) pixels as a lens without distortion would have seen them.");
  m.def("projection_matrices",
        &projection_matrices,
        py::arg("arrays"),
        "(C, 3, 4) projection matrices to pixels, distortion left out.");
  m.def(
      "check_jacobians",
      [](const py::dict& arrays, int max_observations) {
        const KeptArrays kept(arrays);
        const ba::Problem problem = problem_of(arrays);
        return or_failures_of(problem, [&] {
          const ReleasedGil released;
          return ba::check_jacobians(problem, max_observations);
        });
      },
      py::arg("arrays"),
      py::arg("max_observations") = 1000,
      "Analytic against numeric derivatives.");
}

}  // namespace sfmcpp::bindings

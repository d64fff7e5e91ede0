#include <map>

#include <pybind11/stl.h>

#include "module.hpp"
#include "sfmcpp/ba/solve.hpp"

namespace sfmcpp::bindings {
namespace {

void bind_iteration(py::module_& m) {
  using I = optim::Iteration;
  py::class_<I>(m, "CoreIteration", "One iteration of the minimiser; number 0 is the start.")
      .def_readonly("iteration", &I::number)
      .def_readonly("cost", &I::cost)
      .def_readonly("seconds", &I::seconds)
      .def_readonly("accepted", &I::accepted)
      .def_readonly("damping", &I::damping)
      .def_readonly("gradient_norm", &I::gradient_norm)
      .def_readonly("step_norm", &I::step_norm)
      .def_property_readonly(
          "step_lengths", [](const I& i) { return std::pair(i.lengths.camera, i.lengths.point); })
      .def_property_readonly("proposed_lengths",
                             [](const I& i) {
                               std::vector<std::pair<double, double>> pairs;
                               for (const optim::StepLengths& l : i.proposed_lengths)
                                 pairs.emplace_back(l.camera, l.point);
                               return pairs;
                             })
      .def_readonly("line_searched", &I::line_searched)
      .def_readonly("accelerated", &I::accelerated)
      .def_readonly("held_points", &I::held_points)
      .def_readonly("refitted_points", &I::refitted_points)
      .def_readonly("intrinsics_held", &I::intrinsics_held)
      .def_readonly("cost_evaluations", &I::cost_evaluations)
      .def_readonly("linear_solver_iterations", &I::linear_solver_iterations);
}

py::dict works(const linear::Works& amounts) {
  py::dict named;
  for (const auto& row : EnumTraits<linear::Work>::kTable) {
    const double amount = linear::amount_of(amounts, row.value);
    if (amount != 0.0) named[py::str(std::string(row.name))] = amount;
  }
  return named;
}

py::list forecasts(const ba::SolveSummary& summary) {
  py::list list;
  for (std::size_t k = 0; k < summary.forecast_seconds.size(); ++k) {
    const linear::SolverForecast& forecast = summary.linear_solver.forecasts[k];
    py::dict d;
    d["solver"] = enum_name(forecast.kind);
    d["flops"] = forecast.flops();
    d["bytes"] = summary.linear_solver.held_bytes + forecast.bytes;
    d["seconds"] = summary.forecast_seconds[k];
    d["iterations"] = forecast.iterations;
    d["work_once"] = works(forecast.once);
    d["work_of_step"] = works(forecast.step);
    d["work_of_iteration"] = works(forecast.iteration);
    list.append(d);
  }
  return list;
}

py::list changes(const ba::SolveSummary& summary) {
  py::list list;
  for (const linear::SolverChange& change : summary.solver_changes) {
    py::dict d;
    d["solves"] = change.solves;
    d["solver"] = enum_name(change.kind);
    d["reason"] = change.reason;
    list.append(d);
  }
  return list;
}

void def_minimizer_part(py::class_<ba::SolveSummary>& c) {
  using S = ba::SolveSummary;
  c.def_property_readonly("initial_cost", [](const S& s) { return s.minimizer.initial_cost; });
  c.def_property_readonly("final_cost", [](const S& s) { return s.minimizer.final_cost; });
  c.def_property_readonly("termination",
                          [](const S& s) { return enum_name(s.minimizer.termination); });
  c.def_property_readonly("message", [](const S& s) { return s.minimizer.message; });
  c.def_property_readonly("iterations", [](const S& s) { return s.minimizer.iterations; });
}

}  // namespace

void bind_summary(py::module_& m) {
  bind_iteration(m);
  using S = ba::SolveSummary;
  py::class_<S> c(m, "CoreSummary", "What a solve did.");
  def_minimizer_part(c);
  c.def_readonly("initial_rms_px", &S::initial_rms_px);
  c.def_readonly("final_rms_px", &S::final_rms_px);
  c.def_property_readonly("point_steps", [](const S& s) { return enum_name(s.point_steps); });
  c.def_property_readonly("linear_solver", [](const S& s) -> std::string_view {
    if (!s.solves_linear_system) return "none";
    return enum_name(s.linear_solver.kind);
  });
  c.def_property_readonly("linear_solver_reason",
                          [](const S& s) { return s.linear_solver.reason; });
  c.def_property_readonly("linear_solver_forecast", &forecasts);
  c.def_property_readonly("linear_solver_changes", &changes);
  c.def_readonly("loss_scale_px", &S::loss_scale_px);
  c.def_readonly("threads", &S::num_threads);
  c.def_readonly("seconds_setup", &S::seconds_setup);
  c.def_readonly("seconds_total", &S::seconds_total);
  c.def_readonly("warnings", &S::warnings);
  c.def_property_readonly("constraint_costs", [](const S& s) {
    std::map<std::string, std::pair<double, double>> costs;
    for (const ba::ConstraintGroupCost& group : s.constraint_costs)
      costs[group.name] = {group.initial_cost, group.final_cost};
    return costs;
  });
  c.def_property_readonly("observations_behind_camera", [](const S& s) {
    return std::pair(s.behind_camera_initial, s.behind_camera_final);
  });
}

}  // namespace sfmcpp::bindings

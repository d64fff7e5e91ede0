#include "options.hpp"

#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <variant>

#include <pybind11/stl.h>

namespace sfmcpp::bindings {
namespace {

template <class E>
std::vector<std::string> names_of() {
  std::vector<std::string> names;
  names.reserve(EnumNames<E>::kTable.size());
  for (const auto& [value, name] : EnumNames<E>::kTable) names.emplace_back(name);
  return names;
}

// An enum option is text in Python.
template <class E, class Get>
void def_enum(py::class_<ba::SolveOptions>& c, const char* name, const Get& get, const char* doc) {
  c.def_property(
      name,
      [get](ba::SolveOptions& o) { return std::string(enum_name(get(o))); },
      [get](ba::SolveOptions& o, const std::string& text) { get(o) = parse_enum<E>(text); },
      doc);
}

template <class T, class Get>
void def_value(py::class_<ba::SolveOptions>& c, const char* name, const Get& get, const char* doc) {
  c.def_property(
      name,
      [get](ba::SolveOptions& o) -> T { return get(o); },
      [get](ba::SolveOptions& o, T value) { get(o) = value; },
      doc);
}

void def_choices(py::class_<ba::SolveOptions>& c) {
  using O = ba::SolveOptions;
  def_enum<optim::Method>(
      c, "method", [](O & o) -> auto& { return o.minimizer.method; }, "Minimiser.");
  def_enum<optim::LineSearchKind>(
      c,
      "line_search",
      [](O & o) -> auto& { return o.minimizer.line_search.kind; },
      "Line search along each step.");
  def_enum<optim::BacktrackingTest>(
      c,
      "backtracking_test",
      [](O & o) -> auto& { return o.minimizer.line_search.backtracking_test; },
      "What a backtracking line search demands of a length.");
  def_enum<ba::AlgebraicWeights>(
      c,
      "algebraic_weights",
      [](O & o) -> auto& { return o.algebraic_weights; },
      "How observations count in an algebraic line search.");
  def_enum<linear::LinearSolverKind>(
      c,
      "linear_solver",
      [](O & o) -> auto& { return o.linear_solver.kind; },
      "Solver of the normal equations.");
  def_enum<linear::DampingMatrix>(
      c,
      "damping_matrix",
      [](O & o) -> auto& { return o.minimizer.damping_matrix; },
      "What λ multiplies: the diagonal of JᵀJ, or the identity.");
  def_enum<LossKind>(
      c, "loss", [](O & o) -> auto& { return o.loss; }, "Robust loss.");
  def_enum<ba::Gauge>(
      c, "gauge", [](O & o) -> auto& { return o.gauge; }, "What holds the similarity freedom.");
}

void def_line_search(py::class_<ba::SolveOptions>& c) {
  using O = ba::SolveOptions;
  def_value<int>(
      c,
      "line_search_iterations",
      [](O & o) -> auto& { return o.minimizer.line_search.iterations; },
      "Iterations, from the first on, that search along their step.");
  def_value<std::optional<double>>(
      c,
      "line_search_damping",
      [](O & o) -> auto& { return o.minimizer.line_search.damping_threshold; },
      "Search in later iterations too while λ is above this; None: do not.");
  def_value<bool>(
      c,
      "line_search_on_rejection",
      [](O & o) -> auto& { return o.minimizer.line_search.on_rejection; },
      "Search in later iterations too where the unit step would be rejected.");
}

void def_numbers(py::class_<ba::SolveOptions>& c) {
  using O = ba::SolveOptions;
  def_value<std::optional<double>>(
      c,
      "initial_damping",
      [](O & o) -> auto& { return o.minimizer.initial_damping; },
      "First λ; None: that of the method.");
  def_value<std::optional<double>>(
      c,
      "initial_radius",
      [](O & o) -> auto& { return o.minimizer.initial_radius; },
      "First radius of the Dog-Leg; None: that of the method.");
  def_value<int>(
      c,
      "max_iterations",
      [](O & o) -> auto& { return o.minimizer.termination.max_iterations; },
      "Steps tried at most, rejected ones included.");
  def_value<double>(
      c,
      "function_tolerance",
      [](O & o) -> auto& { return o.minimizer.termination.function_tolerance; },
      "Stop when an accepted step decreases the cost by less than this share.");
  def_value<double>(
      c,
      "gradient_tolerance",
      [](O & o) -> auto& { return o.minimizer.termination.gradient_tolerance; },
      "Stop when no entry of the gradient is larger.");
  def_value<double>(
      c,
      "parameter_tolerance",
      [](O & o) -> auto& { return o.minimizer.termination.parameter_tolerance; },
      "Stop when the step is shorter than this share of the unknowns' norm.");
  def_value<double>(
      c,
      "pcg_tolerance",
      [](O & o) -> auto& { return o.linear_solver.pcg_tolerance; },
      "Relative residual at which the iterative linear solver stops.");
  def_value<int>(
      c,
      "pcg_max_iterations",
      [](O & o) -> auto& { return o.linear_solver.pcg_max_iterations; },
      "Iterations of the iterative linear solver at most.");
  def_value<int>(
      c, "threads", [](O & o) -> auto& { return o.num_threads; }, "Threads; 0: as many as useful.");
}

// Options whose Python type is a union.
void def_unions(py::class_<ba::SolveOptions>& c) {
  using O = ba::SolveOptions;
  c.def_property(
      "loss_scale_px",
      [](const O& o) -> std::variant<double, std::string> {
        if (o.automatic_loss_scale) return std::string("auto");
        return o.loss_scale_px;
      },
      [](O& o, const std::variant<double, std::string>& value) {
        const auto* text = std::get_if<std::string>(&value);
        if (text != nullptr && *text != "auto") {
          throw InvalidArgument("loss_scale_px = '" + *text +
                                "': must be a number of pixels or 'auto'");
        }
        o.automatic_loss_scale = text != nullptr;
        if (text == nullptr) o.loss_scale_px = std::get<double>(value);
      },
      "Residual at which the loss leaves the parabola [px]; 'auto': from the median residual at "
      "the start.");
  c.def_property(
      "max_seconds",
      [](const O& o) -> std::optional<double> {
        const double seconds = o.minimizer.termination.max_seconds;
        return std::isinf(seconds) ? std::nullopt : std::optional(seconds);
      },
      [](O& o, std::optional<double> value) {
        o.minimizer.termination.max_seconds =
            value.value_or(std::numeric_limits<double>::infinity());
      },
      "Time limit [s]; None: none.");
}

}  // namespace

void bind_options(py::module_& m) {
  py::class_<ba::SolveOptions> c(
      m, "SolveOptions", "Options of a solve, with the defaults of the core.");
  c.def(py::init<>());
  def_choices(c);
  def_line_search(c);
  def_numbers(c);
  def_unions(c);
  c.def("validate",
        &ba::SolveOptions::validate,
        "Raise InvalidArgument naming every option out of its range.");
  m.attr("METHODS") = py::tuple(py::cast(names_of<optim::Method>()));
  m.attr("LINE_SEARCHES") = py::tuple(py::cast(names_of<optim::LineSearchKind>()));
  m.attr("LINEAR_SOLVERS") = py::tuple(py::cast(names_of<linear::LinearSolverKind>()));
  m.attr("LOSSES") = py::tuple(py::cast(names_of<LossKind>()));
  m.attr("GAUGES") = py::tuple(py::cast(names_of<ba::Gauge>()));
}

}  // namespace sfmcpp::bindings

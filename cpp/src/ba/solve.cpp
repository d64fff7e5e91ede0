#include "sfmcpp/ba/solve.hpp"

#include <cmath>

#include "sfmcpp/ba/bundle_model.hpp"
#include "sfmcpp/ba/check.hpp"
#include "sfmcpp/core/error.hpp"
#include "sfmcpp/core/options_check.hpp"
#include "sfmcpp/math/statistics.hpp"
#include "sfmcpp/optim/minimizer.hpp"

namespace sfmcpp::ba {
namespace {

bool fixes_gauge(const SolveOptions& options) {
  const bool undamped = options.minimizer.method == optim::Method::kGaussNewton;
  if (options.gauge == Gauge::kFree && undamped) {
    throw InvalidArgument(
        "gauge = 'free' with method = 'gauss-newton': without damping the gauge must be 'fixed'");
  }
  return options.gauge == Gauge::kFixed || undamped;
}

double rms(const std::vector<double>& residuals) {
  double sum = 0.0;
  for (double r : residuals) sum += r * r;
  return std::sqrt(sum / static_cast<double>(residuals.size()));
}

void check_state(const Problem& problem, const optim::State& state) {
  if (state.cameras.size() == problem.cameras.size() &&
      state.intrinsics.size() == problem.intrinsics.size() &&
      state.points.size() == problem.points.size()) {
    return;
  }
  throw InvalidArgument("state: its sizes differ from those of the problem");
}

Loss make_loss(const SolveOptions& options, const std::vector<double>& residuals) {
  if (!options.automatic_loss_scale) return {options.loss, options.loss_scale_px};
  // Exact data has no spread to learn from; any positive scale then leaves every residual alone.
  const double sigma = std::max(mad_sigma(residuals), 1e-9);
  return {options.loss, efficient_scale(options.loss, sigma)};
}

void warn_behind(const SolveSummary& summary, std::vector<std::string>& warnings) {
  if (summary.behind_camera_initial + summary.behind_camera_final == 0) return;
  warnings.push_back(
      std::to_string(summary.behind_camera_initial) + " observations at the start and " +
      std::to_string(summary.behind_camera_final) +
      " at the end are of points behind their camera; their residual keeps the formula's value");
}

// Everything a solve owns, in the order it must be made.
struct Workspace {
  Workspace(const Problem& problem, const SolveOptions& options)
      : graph(graph_of(problem)),
        intrinsics(free_intrinsics(problem, graph)),
        map(make_parameter_map(problem, graph, intrinsics, fixes_gauge(options))),
        pool(resolve_num_threads(options.num_threads, problem.num_observations())),
        model(problem, graph, map, intrinsics, pool) {}

  linear::ObservationGraph graph;
  std::vector<int> intrinsics;
  linear::ParameterMap map;
  ThreadPool pool;
  BundleModel model;
};

void describe_start(Workspace& work,
                    const SolveOptions& options,
                    const optim::State& state,
                    SolveSummary& summary) {
  const std::vector<double> residuals = work.model.residuals(state);
  summary.initial_rms_px = rms(residuals);
  summary.behind_camera_initial = work.model.num_behind_camera(state);
  summary.warnings = warnings_about(work.graph);
  const Loss loss = make_loss(options, residuals);
  summary.loss_scale_px = loss.scale;
  work.model.set_loss(loss);
}

void describe_end(Workspace& work, const optim::State& state, SolveSummary& summary) {
  summary.final_rms_px = rms(work.model.residuals(state));
  summary.behind_camera_final = work.model.num_behind_camera(state);
  warn_behind(summary, summary.warnings);
}

}  // namespace

void SolveOptions::validate() const {
  OptionsCheck check;
  const optim::TerminationOptions& t = minimizer.termination;
  check.require(t.max_iterations >= 0, "max_iterations", t.max_iterations, "at least 0");
  check.require(t.max_seconds > 0.0, "max_seconds", t.max_seconds, "positive");
  check.require(
      t.function_tolerance >= 0.0, "function_tolerance", t.function_tolerance, "at least 0");
  check.require(
      t.gradient_tolerance >= 0.0, "gradient_tolerance", t.gradient_tolerance, "at least 0");
  check.require(
      t.parameter_tolerance >= 0.0, "parameter_tolerance", t.parameter_tolerance, "at least 0");
  const double damping = minimizer.initial_damping.value_or(1.0);
  check.require(
      damping > 0.0 && std::isfinite(damping), "initial_damping", damping, "positive and finite");
  check.require(loss_scale_px > 0.0 && std::isfinite(loss_scale_px),
                "loss_scale_px",
                loss_scale_px,
                "positive and finite");
  check.require(linear_solver.pcg_tolerance > 0.0 && linear_solver.pcg_tolerance < 1.0,
                "pcg_tolerance",
                linear_solver.pcg_tolerance,
                "in (0, 1)");
  check.require(linear_solver.pcg_max_iterations > 0,
                "pcg_max_iterations",
                linear_solver.pcg_max_iterations,
                "at least 1");
  check.require(num_threads >= 0 && num_threads <= 1024, "threads", num_threads, "in [0, 1024]");
  check.done();
}

SolveSummary solve(const Problem& problem,
                   const SolveOptions& options,
                   const optim::Events& events,
                   optim::State& state) {
  const Stopwatch clock;
  options.validate();
  check_arrays(problem);
  check_state(problem, state);
  Workspace work(problem, options);
  check_duplicates(problem, work.graph);
  check_determined(work.graph, work.map);

  SolveSummary summary;
  summary.num_threads = work.pool.num_threads();
  describe_start(work, options, state, summary);
  summary.linear_solver =
      linear::choose_linear_solver(work.graph, work.map, options.linear_solver.kind);
  linear::LinearSolverOptions solver_options = options.linear_solver;
  solver_options.kind = summary.linear_solver.kind;
  const auto solver = linear::make_linear_solver(work.model.normal_equations(), solver_options);
  summary.seconds_setup = clock.seconds();

  summary.minimizer = optim::minimize(work.model, *solver, options.minimizer, events, clock, state);
  describe_end(work, state, summary);
  summary.seconds_total = clock.seconds();
  return summary;
}

}  // namespace sfmcpp::ba

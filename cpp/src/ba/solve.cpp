#include "sfmcpp/ba/solve.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <span>

#include "sfmcpp/ba/check.hpp"
#include "sfmcpp/ba/rigs.hpp"
#include "sfmcpp/core/error.hpp"
#include "sfmcpp/core/stopwatch.hpp"
#include "sfmcpp/optim/minimizer.hpp"
#include "sfmcpp/optim/step_strategy.hpp"
#include "workspace.hpp"

namespace sfmcpp::ba {
namespace {

void warn_behind(const SolveSummary& summary, std::vector<std::string>& warnings) {
  if (summary.behind_camera_initial + summary.behind_camera_final == 0) return;
  warnings.push_back(
      std::to_string(summary.behind_camera_initial) + " observations at the start and " +
      std::to_string(summary.behind_camera_final) +
      " at the end are of points behind their camera; their residual keeps the formula's value");
}

// What was asked for while the linear solver was left to `auto`, and the one taken cannot do.
void warn_of_solver(const linear::LinearSolverChoice& choice,
                    const SolveOptions& options,
                    std::vector<std::string>& warnings) {
  if (choice.kind != linear::LinearSolverKind::kIterative) return;
  if (options.minimizer.acceleration == optim::Acceleration::kGeodesic)
    warnings.push_back(
        "acceleration = 'geodesic': the linear solver chosen, 'iterative', keeps no factors to "
        "solve for the cameras again, so its steps are straight; choose 'points' or a direct "
        "solver");
  const linear::PreconditionerKind wanted = options.linear_solver.preconditioner;
  if (linear::needs_blocks(wanted) && !choice.with_blocks)
    warnings.push_back(enum_setting(wanted) +
                       ": 'schur-jacobi' is taken, the Schur complement is not formed in blocks");
}

// Measuring this machine takes a few milliseconds, once; no step waits for it.
constexpr double kSecondsWorthMeasuring = 0.1;

std::vector<double> forecast_seconds(const linear::LinearSolverChoice& choice, ThreadPool& pool) {
  linear::Works rates = linear::reference_rates();
  for (const linear::SolverForecast& forecast : choice.forecasts) {
    if (forecast.kind != choice.kind || forecast.seconds(rates) < kSecondsWorthMeasuring) continue;
    rates = linear::rates_of_this_machine(pool);
    break;
  }
  std::vector<double> seconds;
  for (const linear::SolverForecast& forecast : choice.forecasts)
    seconds.push_back(forecast.seconds(rates));
  return seconds;
}

// All of the summary but what is known from residuals of the images.
SolveSummary describe_start(const Workspace& work,
                            const Problem& problem,
                            const SolveOptions& options,
                            const optim::State& state) {
  SolveSummary summary;
  summary.num_threads = work.pool.num_threads();
  const bool constrained = work.model.constraints().num_equations() > 0;
  Anchors anchors = anchors_of(problem);
  anchors.constrained = constrained;
  anchors.of_others = work.rows.points();
  std::vector<std::string> of_baselines;
  work.pool.parallel_for_beside(
      [&] { summary.warnings = warnings_about(work.graph, problem.rigs, anchors, work.exchange); },
      1,
      [&](int) {
        of_baselines = warnings_about_baselines(problem, work.graph, work.rows.points());
      });
  std::ranges::move(of_baselines, std::back_inserter(summary.warnings));
  std::ranges::move(warnings_about_cameras(problem, work.graph, constrained),
                    std::back_inserter(summary.warnings));
  std::ranges::move(FreeSensors(problem, work.graph).warnings(),
                    std::back_inserter(summary.warnings));
  if (facts_of(options.minimizer.method).solves_linear_system)
    warn_of_solver(work.choice, options, summary.warnings);
  const std::vector<double> costs = work.model.constraints().costs(state);
  for (std::size_t k = 0; k < costs.size(); ++k)
    summary.constraint_costs.push_back({problem.constraints->groups()[k].name, costs[k], costs[k]});
  if (problem.camera_model.function() == nullptr)
    summary.point_steps = optim::point_steps_of(options.minimizer);
  summary.solves_linear_system = facts_of(options.minimizer.method).solves_linear_system;
  summary.linear_solver = work.choice;
  return summary;
}

bool are_finite(std::span<const double> numbers) {
  return std::ranges::all_of(numbers, [](double x) { return std::isfinite(x); });
}

constexpr const char* kUnsoundResidual = "its squared residual is not a finite number";
constexpr const char* kUnsoundDerivative = "a derivative of its residual is not a finite number";

// The first of those that have numbers which are not finite, and how many there are.
struct Unsound {
  const char* what = nullptr;
  long first = 0, count = 0;

  void add(long number, double squared, bool derivatives_are_finite) {
    if (std::isfinite(squared) && derivatives_are_finite) return;
    if (count++ > 0 && first < number) return;
    first = number;
    what = std::isfinite(squared) ? kUnsoundDerivative : kUnsoundResidual;
  }
};

Unsound unsound_observations(const Workspace& work, const optim::State& state) {
  const std::size_t width = work.map.camera_size;
  AlignedVector<double> by_camera(2 * width * linear::kChunkSize);
  AlignedVector<double> records(std::size_t{residuals::kRecordSize} * linear::kChunkSize);
  const residuals::JacobianOutput out{
      .free_intrinsics = work.intrinsics.data(),
      .num_free_intrinsics = static_cast<int>(work.intrinsics.size()),
      .camera_size = work.map.camera_size,
      .camera = by_camera.data(),
      .point = records.data()};
  Unsound found;
  work.model.images().prepare(state);
  for (const linear::Chunk& chunk : work.graph.chunks) {
    work.model.images().linearize(state, chunk, out);
    for (int k = 0; k < chunk.end - chunk.begin; ++k) {
      const double* record = records.data() + long{residuals::kRecordSize} * k;
      const bool finite = are_finite({record, residuals::kRecordSize}) &&
                          are_finite({&by_camera[2 * width * k], 2 * width});
      found.add(work.graph.source[chunk.begin + k], residuals::squared_residual(record), finite);
    }
  }
  return found;
}

// Where a solve has failed: which numbers are not finite there.
void warn_of_numbers(const Workspace& work,
                     const Problem& problem,
                     const optim::State& state,
                     std::vector<std::string>& warnings) {
  if (const Unsound found = unsound_observations(work, state); found.count > 0) {
    warnings.push_back(
        "point " + std::to_string(problem.point_index[found.first]) + ": " + found.what +
        " in camera " + std::to_string(problem.camera_index[found.first]) + ", observation " +
        std::to_string(found.first) + " (" + std::to_string(found.count) + " such observations)");
  }
  if (problem.constraints == nullptr) return;
  for (const residuals::ConstraintGroup& group : problem.constraints->groups()) {
    Unsound found;
    work.model.constraints().for_each_active(
        group, state, [&](std::size_t k, residuals::ConstraintResidual& e) {
          const bool finite =
              are_finite(e.by_camera) && are_finite(e.by_previous) && are_finite(e.by_point);
          found.add(static_cast<long>(k), residuals::squared_error(e), finite);
        });
    if (found.count > 0)
      warnings.push_back(residuals::name_of(group, static_cast<std::size_t>(found.first)) + ": " +
                         found.what + " (" + std::to_string(found.count) + " such members)");
  }
}

void check_callable(const optim::Events& events) {
  if (events.on_start && events.on_iteration && events.poll) return;
  throw InvalidArgument("events: on_start, on_iteration and poll must be callable");
}

// The minimiser's first linearisation is at the start: no residual is evaluated for this alone.
optim::Events noting_the_start(const optim::Events& events,
                               const BundleModel& model,
                               SolveSummary& summary) {
  optim::Events noting = events;
  noting.on_start = [&] {
    summary.initial_rms_px = model.fit_where_linearized().rms();
    summary.behind_camera_initial = static_cast<int>(model.fit_where_linearized().behind_camera);
    events.on_start();
  };
  return noting;
}

// The solver's memory is free before the machine is measured, which takes some of its own.
void describe_end(Workspace& work,
                  const Problem& problem,
                  const optim::State& state,
                  SolveSummary& summary) {
  summary.solver_changes = work.solver->changes();
  work.solver.reset();
  summary.forecast_seconds = forecast_seconds(work.choice, work.pool);
  summary.loss_scale_px = work.model.images().loss().scale;
  const ImageFit fit = work.model.images().fit(state);
  summary.final_rms_px = fit.rms();
  summary.behind_camera_final = static_cast<int>(fit.behind_camera);
  const std::vector<double> costs = work.model.constraints().costs(state);
  for (std::size_t k = 0; k < costs.size(); ++k) summary.constraint_costs[k].final_cost = costs[k];
  warn_behind(summary, summary.warnings);
  if (summary.minimizer.termination == optim::Termination::kNumericalFailure ||
      summary.minimizer.termination == optim::Termination::kStalled)
    warn_of_numbers(work, problem, state, summary.warnings);
  std::ranges::move(
      warnings_about_parallax(
          problem, work.graph, state, summary.final_rms_px, work.exchange, work.rows.points()),
      std::back_inserter(summary.warnings));
}

}  // namespace

SolveSummary solve(const Problem& problem,
                   const SolveOptions& options,
                   const optim::Events& events,
                   optim::State& state,
                   Exchange& exchange,
                   const optim::Resumption* resumed) {
  const Stopwatch clock(resumed == nullptr ? 0.0 : resumed->seconds), setup;
  check_callable(events);
  Workspace work(problem, options, state, exchange);
  if (options.loss == LossKind::kAuto)
    work.model.let_scale_fall(state, options.loss_scale_px.value_or(0.0));
  SolveSummary summary = describe_start(work, problem, options, state);
  summary.seconds_setup = setup.seconds();
  {
    const ScopedFrame frame(problem, state, exchange);
    summary.minimizer = optim::minimize(work.model,
                                        *work.solver,
                                        options.minimizer,
                                        noting_the_start(events, work.model, summary),
                                        clock,
                                        state,
                                        resumed);
  }
  // A point in the centre of a projective camera has an image that rounding decides, and the frame
  // of the solve has another rounding.
  if (!is_metric(problem.camera_model)) summary.minimizer.final_cost = work.model.cost(state);
  describe_end(work, problem, state, summary);
  summary.seconds_total = clock.seconds();
  return summary;
}

StepExploration explore_step(const Problem& problem,
                             const SolveOptions& options,
                             std::span<const optim::StepLengths> lengths,
                             optim::State& start) {
  // The algebraic cost is told without a search along it too.
  SolveOptions of_step = options;
  of_step.algebraic_weights = AlgebraicWeights::kUniform;
  Workspace work(problem, of_step, start);
  work.model.set_algebraic_weights(options.algebraic_weights);
  const ScopedFrame frame(problem, start);
  work.model.normalize(start);
  work.model.linearize(start);
  StepExploration result;
  linear::Step step;
  const auto strategy = optim::make_step_strategy(options.minimizer);
  result.valid = strategy
                     ->compute(
                         work.model.normal_equations(), *work.solver, [] { return false; }, step)
                     .valid;
  result.damping = strategy->damping();
  if (!result.valid) return result;
  result.algebraic = work.model.algebraic_cost(start, step).value_or(Biquadratic{});
  optim::State candidate = start;
  for (const optim::StepLengths& l : lengths) {
    work.model.plus(start, step, l, candidate);
    result.geometric.push_back(work.model.cost(candidate));
  }
  work.model.plus(start, step, {}, candidate);
  start = candidate;
  return result;
}

}  // namespace sfmcpp::ba

#include "workspace.hpp"

#include <algorithm>
#include <exception>
#include <functional>

#include "sfmcpp/ba/check.hpp"
#include "sfmcpp/ba/held_cameras.hpp"
#include "sfmcpp/ba/rigs.hpp"
#include "sfmcpp/core/buffer_store.hpp"
#include "sfmcpp/core/error.hpp"
#include "sfmcpp/core/machine.hpp"
#include "sfmcpp/math/statistics.hpp"

namespace sfmcpp::ba {
namespace {

bool fixes_gauge(const Problem& problem, const SolveOptions& options) {
  const bool undamped = facts_of(options.minimizer.method).needs_fixed_gauge();
  if (options.gauge == Gauge::kFree && undamped) {
    throw InvalidArgument(
        "gauge = 'free' with method = 'gauss-newton': without damping the gauge must be 'fixed'");
  }
  const bool fixed = options.gauge == Gauge::kFixed || undamped;
  if (fixed && !is_metric(problem.camera_model)) {
    throw InvalidArgument(
        "camera_model = 'projective': its gauge of 15 degrees of freedom is left to damping; "
        "neither gauge = 'fixed' nor method = 'gauss-newton' applies");
  }
  return fixed;
}

template <class T>
[[noreturn]] void refuse_of_function(const Problem& problem, T value, const char* reason) {
  throw InvalidArgument("camera_model = '" + std::string(problem.camera_model.name()) +
                        "', a function, with " + enum_setting(value) + ": " + reason);
}

// What asks for more than the images of all observations at a state.
void refuse_beyond_functions(const Problem& problem, const SolveOptions& options) {
  using Search = optim::LineSearchKind;
  using Steps = optim::PointSteps;
  if (problem.camera_model.function() == nullptr) return;
  const Search search = options.minimizer.line_search.kind;
  if (search == Search::kGlobalAlgebraic || search == Search::kTwoWayAlgebraic)
    refuse_of_function(problem, search, "it needs matrices of the cameras; choose another");
  const Steps steps = options.minimizer.point_steps;
  if (steps == Steps::kHeldBack || steps == Steps::kRefitted)
    refuse_of_function(problem, steps, "it looks at points one by one; leave 'auto'");
  const auto intrinsics = options.minimizer.intrinsic_steps;
  if (intrinsics == optim::IntrinsicSteps::kLate)
    refuse_of_function(problem, intrinsics, "it looks at focal lengths; leave 'auto'");
}

void check_state_size(const char* array, std::size_t size, std::size_t wanted) {
  if (size == wanted) return;
  throw InvalidArgument(std::string("state.") + array + ": " + std::to_string(size) +
                        " values, must be " + std::to_string(wanted) + " as in the problem");
}

// A start other than the problem's own is held to the same rules.
void check_state(const Problem& problem, const optim::State& state) {
  check_state_size("cameras", state.cameras.size(), problem.cameras.size());
  check_state_size("intrinsics", state.intrinsics.size(), problem.intrinsics.size());
  check_state_size("points", state.points.size(), problem.points.size());
  check_state_size("sensors", state.sensors.size(), problem.rigs.sensors.size());
  if (std::ranges::equal(state.cameras, problem.cameras) &&
      std::ranges::equal(state.intrinsics, problem.intrinsics) &&
      std::ranges::equal(state.points, problem.points) &&
      std::ranges::equal(state.sensors, problem.rigs.sensors)) {
    return;
  }
  Problem there = problem;
  there.cameras = state.cameras;
  there.intrinsics = state.intrinsics;
  there.points = state.points;
  there.rigs.sensors = state.sensors;
  try {
    check_values(there);
    check_rigs(there);
  } catch (const InvalidArgument& error) {
    throw InvalidArgument(std::string("state: ") + error.what());
  }
}

Loss make_loss(const SolveOptions& options,
               const ImageResiduals& images,
               const optim::State& start,
               Exchange& exchange) {
  Loss loss{.kind = options.loss, .table = options.loss_table};
  if (options.loss_scale_px) {
    loss.scale = *options.loss_scale_px;
    return loss;
  }
  if (!options.is_robust()) return loss;  // which has no scale
  if (loss.kind == LossKind::kAuto) return {loss.kind, FallingScale(images, 0.0).at(start)};
  const double sigma = std::max(mad_sigma(exchange.gather(images.values(start))), kLeastLossScale);
  loss.scale = efficient_scale(loss, sigma);
  return loss;
}

// A rank whose part breaks a rule makes all others throw too: they would wait for its sums.
template <class F>
void check_on_all_ranks(Exchange& exchange, const F& check) {
  std::exception_ptr refusal;
  std::string reason;
  try {
    check();
  } catch (const InvalidArgument& error) {
    refusal = std::current_exception();
    reason = "rank " + std::to_string(exchange.rank()) + ": " + error.what() + "\n";
  }
  if (!exchange.agree(refusal != nullptr)) return;
  const std::vector<double> letters =
      exchange.gather(std::vector<double>(reason.begin(), reason.end()));
  if (refusal) std::rethrow_exception(refusal);
  throw InvalidArgument(std::string(letters.begin(), std::ranges::find(letters, double{'\n'})));
}

// One where the options are refused, which checked_graph does.
int threads_for(const Problem& problem, const SolveOptions& options) {
  try {
    options.validate();
  } catch (const InvalidArgument&) {
    return 1;
  }
  return resolve_num_threads(options.num_threads, problem.num_observations());
}

// What a call has thrown.
template <class F>
std::exception_ptr thrown_by(const F& call) {
  try {
    call();
  } catch (...) {
    return std::current_exception();
  }
  return nullptr;
}

void rethrow(const std::exception_ptr& thrown) {
  if (thrown) std::rethrow_exception(thrown);
}

// Cameras without observations that a constraint or their frame determines.
void hold_cameras(const Problem& problem,
                  const optim::State& start,
                  linear::ObservationGraph& graph) {
  const Frames frames(problem);
  frames.hold_cameras(graph);
  const std::vector<std::uint8_t> held = cameras_held_by_constraints(problem, graph, start);
  if (held.empty()) return;
  graph.held.resize(held.size());
  std::ranges::transform(graph.held, held, graph.held.begin(), std::bit_or<>());
  frames.hold_cameras(graph);
}

// The pages of the largest arrays of a solve, which the system makes while a thread has nothing
// else to do: they would cost a small problem as much as a step. What was touched before has its
// pages; what finds no room in the store is not of the store.
class PagesAhead {
 public:
  PagesAhead(const Problem& problem, const ThreadPool& pool)
      : store_(BufferStore::of_process()), begin_(store_.touched()), end_(begin_) {
    // J, A|r, pixels and σ; V, Jᵀr, M, y and a sum.
    constexpr std::size_t kBytesOfObservation = 240, kBytesOfPoint = 170;
    const std::size_t end = kBytesOfObservation * problem.point_index.size() +
                            kBytesOfPoint * static_cast<std::size_t>(problem.num_points());
    if (pool.num_threads() > 1 && end <= store_.size()) end_ = std::max(begin_, end);
  }

  int parts() const { return ThreadPool::num_parts(static_cast<long>(end_ - begin_), kPart); }
  void populate(int part) const {
    const std::size_t first = begin_ + static_cast<std::size_t>(part * kPart);
    store_.populate(first, std::min(first + kPart, end_));
  }

 private:
  static constexpr long kPart = 64L << 10;

  BufferStore& store_;
  std::size_t begin_, end_;
};

// The graph needs indices alone: it is made while the other numbers are checked, and while it is
// read from files how much memory a process may have, which the choice of the solver asks next.
linear::ObservationGraph checked_graph(const Problem& problem,
                                       const SolveOptions& options,
                                       const optim::State& start,
                                       ThreadPool& pool,
                                       Exchange& exchange) {
  linear::ObservationGraph graph;
  check_on_all_ranks(exchange, [&] {
    options.validate();
    refuse_beyond_functions(problem, options);
    check_sizes(problem);
    std::exception_ptr of_indices, of_values;
    const auto use_indices = [&] {
      check_indices(problem);
      graph = graph_of_this_rank(problem);
    };
    const PagesAhead pages(problem, pool);
    pool.parallel_for_beside([&] { of_indices = thrown_by(use_indices); },
                             2 + pages.parts(),
                             [&](int task) {
                               if (task > 1) return pages.populate(task - 2);
                               if (task > 0) return static_cast<void>(memory_limit_bytes());
                               of_values = thrown_by([&] { check_values(problem); });
                             });
    rethrow(of_indices);
    rethrow(of_values);
    check_rigs(problem);
    check_state(problem, start);
    check_constraints(problem, start);
  });
  exchange.sum(graph.of_camera_on_all_ranks);
  hold_cameras(problem, start, graph);
  return graph;
}

std::vector<PoseParameter> gauge_of(const Problem& problem,
                                    const linear::ObservationGraph& graph,
                                    const SolveOptions& options,
                                    const optim::State& start,
                                    Exchange& exchange) {
  if (!fixes_gauge(problem, options)) return {};
  return choose_gauge(problem, graph, start, exchange);
}

// What a solve keeps besides the problem and what its linear solver keeps.
double held_bytes(const linear::ObservationGraph& graph,
                  const linear::ParameterMap& map,
                  linear::Precision precision,
                  const SolveOptions& options) {
  constexpr double kNumber = sizeof(double), kIndex = sizeof(int);
  const double stored = linear::bytes_of_number(precision);
  const double robust = options.is_robust() ? 1.0 : 0.0;
  const double states = options.minimizer.line_search.kind == optim::LineSearchKind::kNone ? 3 : 4;
  // J and A|r, and what rounding took from the gradient; pixels and σ; second derivatives along a
  // step; the five indices of the graph.
  const double lost = precision == linear::Precision::kSingle ? 4 * sizeof(float) : 0.0;
  const double bent = optim::GeodesicAcceleration(options.minimizer).is_possible() ? 2.0 : 0.0;
  const double of_observation =
      stored * (2.0 * map.camera_size + 8) + lost + kNumber * (3 + robust + bent) + 5 * kIndex;
  // V and Jᵀr, M and y; sums, steps, and states.
  const double of_point = kNumber * (9 + 9 + 3 + 3 * 3 + 3 * states) + kIndex;
  const double of_camera = kNumber * (kCameraStorage * states + 8.0 * map.camera_size);
  // Small arrays besides, and large ones that end within a huge page, as measured.
  constexpr double kMore = 1.05, kHugePage = 2e6;
  return kHugePage + kMore * (graph.num_observations() * of_observation +
                              graph.num_points * of_point + graph.num_cameras * of_camera);
}

// For methods that solve no system of all cameras.
class NoLinearSolver final : public linear::LinearSolver {
 public:
  linear::LinearSolveResult solve(const linear::Damping&,
                                  linear::Step&,
                                  const std::function<bool()>&) override {
    return {};
  }
};

std::unique_ptr<linear::LinearSolver> make_solver(const BundleModel& model,
                                                  const SolveOptions& options,
                                                  const linear::LinearSolverChoice& choice) {
  if (!facts_of(options.minimizer.method).solves_linear_system)
    return std::make_unique<NoLinearSolver>();
  return linear::make_chosen_solver(model.normal_equations(), options.linear_solver, choice);
}

linear::LinearSolverChoice choose_solver(Workspace& work,
                                         const Problem& problem,
                                         const SolveOptions& options) {
  const double held = held_bytes(work.rows.graph(), work.map, work.precision, options);
  if (!facts_of(options.minimizer.method).solves_linear_system) {
    linear::require_memory(options.linear_solver, held, work.exchange);
    return {.kind = linear::LinearSolverKind::kIterative,
            .reason = "the method solves no system of all cameras"};
  }
  const linear::CameraPairs pairs = ConstraintTerms(problem, work.map, work.intrinsics).pairs();
  return linear::choose_linear_solver({.graph = work.rows.graph(),
                                       .map = work.map,
                                       .pool = work.pool,
                                       .pairs = pairs,
                                       .exchange = work.exchange,
                                       .held_bytes = held,
                                       .number_bytes = linear::bytes_of_number(work.precision)},
                                      options.linear_solver);
}

// Conjugate gradients, linear or not, amplify what sums round off, and that depends on how points
// are divided among ranks.
bool amplifies_rounding(const SolveOptions& options, const linear::LinearSolverChoice& choice) {
  const optim::MethodFacts& method = facts_of(options.minimizer.method);
  return method.solves_linear_system ? choice.kind == linear::LinearSolverKind::kIterative
                                     : method.keeps_directions;
}

// A robust loss leaves some points and cameras with hardly any weight, and its steps are
// sensitive: rounded coefficients have cost it steps.
linear::Precision stored_precision(const Problem& problem,
                                   const SolveOptions& options,
                                   Exchange& exchange) {
  const double observations = exchange.sum(double(problem.num_observations()));
  const linear::Precision chosen = linear::choose_precision(options.precision, observations);
  const bool asked_for = options.precision != linear::Precision::kAuto;
  return asked_for || !options.is_robust() ? chosen : linear::Precision::kDouble;
}

void restore(std::span<const std::uint8_t> fixed,
             int width,
             const std::vector<double>& from,
             std::vector<double>& to) {
  for (std::size_t k = 0; k < fixed.size(); ++k) {
    const auto first = static_cast<std::ptrdiff_t>(k) * width;
    if (fixed[k]) std::copy_n(from.begin() + first, width, to.begin() + first);
  }
}

}  // namespace

linear::ParameterMap make_parameter_map(const Problem& problem,
                                        const linear::ObservationGraph& graph,
                                        const PointRows& rows,
                                        const std::vector<int>& free_intrinsics,
                                        const std::vector<PoseParameter>& gauge) {
  linear::ParameterMap map = make_parameter_map(problem, graph, free_intrinsics, gauge);
  rows.add_to(map);
  return map;
}

Workspace::Workspace(const Problem& problem,
                     const SolveOptions& options,
                     const optim::State& start,
                     Exchange& ranks)
    : exchange(ranks),
      threads(threads_for(problem, options)),
      pool(*threads),
      graph(checked_graph(problem, options, start, pool, ranks)),
      rows(problem, graph, ranks),
      intrinsics(free_intrinsics(problem, graph)),
      map(make_parameter_map(
          problem, graph, rows, intrinsics, gauge_of(problem, graph, options, start, ranks))),
      precision(stored_precision(problem, options, ranks)),
      choice(choose_solver(*this, problem, options)),
      model(problem,
            graph,
            rows,
            map,
            intrinsics,
            pool,
            ranks,
            precision,
            amplifies_rounding(options, choice)) {
  check_on_all_ranks(exchange, [&] { check_duplicates(problem, graph); });
  check_determined(graph, map, model.constraints().num_equations(), exchange, [&] {
    return fixes_gauge(problem, options) ? 0L : num_world_freedoms(problem, graph, start, exchange);
  });
  solver = make_solver(model, options, choice);
  model.set_camera_modes_wanted(solver->wants_camera_modes());
  model.set_loss(make_loss(options, model.images(), start, exchange));
  model.set_algebraic_weights(options.algebraic_weights);
}

ScopedFrame::ScopedFrame(const Problem& problem, optim::State& state, Exchange& exchange)
    : problem_(problem), state_(state) {
  if (is_metric(problem.camera_model)) return;
  before_ = state;
  frame_.emplace(state, exchange);
  frame_->enter(state);
}

ScopedFrame::~ScopedFrame() {
  if (!frame_) return;
  frame_->leave(state_);
  restore(problem_.fixed_cameras, kCameraStorage, before_.cameras, state_.cameras);
  restore(problem_.fixed_points, problem_.point_storage(), before_.points, state_.points);
}

}  // namespace sfmcpp::ba

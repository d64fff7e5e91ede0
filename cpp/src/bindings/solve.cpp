#include "sfmcpp/ba/solve.hpp"

#include <algorithm>

#include <pybind11/functional.h>
#include <pybind11/stl.h>

#include "arguments.hpp"
#include "arrays.hpp"
#include "exchange.hpp"
#include "module.hpp"
#include "python_function.hpp"

namespace sfmcpp::bindings {
namespace {

// Ctrl-C as Python sees it. Needs the GIL; swallows the KeyboardInterrupt, which the summary
// reports.
bool interrupted() {
  if (or_wait_for_the_end([] { return PyErr_CheckSignals(); }) == 0) return false;
  if (!PyErr_ExceptionMatches(PyExc_KeyboardInterrupt)) throw py::error_already_set();
  PyErr_Clear();
  return true;
}

using Where = std::function<optim::Resumption()>;

py::dict dict_of(const optim::Resumption& resumption) {
  py::dict d;
  d["cameras"] = array_of(resumption.state.cameras);
  d["intrinsics"] = array_of(resumption.state.intrinsics);
  d["points"] = array_of(resumption.state.points);
  if (!resumption.state.sensors.empty()) d["rig_sensors"] = array_of(resumption.state.sensors);
  d["numbers"] = array_of(resumption.numbers);
  d["seconds"] = array_of<double>({resumption.seconds});
  return d;
}

optim::Resumption resumption_of(const py::dict& d) {
  const auto numbers = [&](const char* name) {
    const std::span<const double> values = view<const double>(d, name);
    return std::vector<double>(values.begin(), values.end());
  };
  const std::vector<double> seconds = numbers("seconds");
  if (seconds.size() != 1) throw InvalidArgument("seconds: must be one number");
  return {.state = {.cameras = numbers("cameras"),
                    .intrinsics = numbers("intrinsics"),
                    .points = numbers("points"),
                    .sensors =
                        d.contains("rig_sensors") ? numbers("rig_sensors") : std::vector<double>()},
          .numbers = numbers("numbers"),
          .seconds = seconds[0]};
}

// Called without the GIL. A Python exception of a callback ends the solve and is raised after it.
class Listener {
 public:
  Listener(py::object callback, py::object checkpoint, const CommunicatorExchange* ranks)
      : callback_(std::move(callback)), checkpoint_(std::move(checkpoint)), ranks_(ranks) {}

  optim::Events events() {
    optim::Events events{
        .on_iteration =
            [this](const optim::Iteration& i) { return guarded([&] { return call(i); }); },
        .poll = [this] { return guarded([] { return optim::Signal::kContinue; }); }};
    if (!checkpoint_.is_none()) {
      events.on_resumable = [this](const Where& where, bool last) {
        asked_ = optim::Signal::kContinue;
        asked_ = guarded([&] { return save(where, last); });
      };
    }
    return events;
  }
  void rethrow() const {
    if (error_) std::rethrow_exception(error_);
  }

 private:
  template <class F>
  optim::Signal guarded(const F& f) {
    const HeldGil held;
    try {
      if (asked_ != optim::Signal::kContinue) return asked_;
      if (interrupted()) return optim::Signal::kInterrupt;
      const optim::Signal answer = f();
      return ranks_ && ranks_->is_interrupted() ? optim::Signal::kInterrupt : answer;
    } catch (const py::error_already_set& e) {
      // Ctrl-C while the callback runs is raised inside it.
      if (e.matches(PyExc_KeyboardInterrupt)) return optim::Signal::kInterrupt;
      error_ = std::current_exception();
      return optim::Signal::kStop;
    } catch (...) {
      error_ = std::current_exception();
      return optim::Signal::kStop;
    }
  }
  optim::Signal call(const optim::Iteration& iteration) const {
    if (callback_.is_none()) return optim::Signal::kContinue;
    const py::object argument = py::cast(iteration);
    PyObject* answer = or_wait_for_the_end(
        [&] { return PyObject_CallFunctionObjArgs(callback_.ptr(), argument.ptr(), nullptr); });
    if (answer == nullptr) throw py::error_already_set();
    return py::reinterpret_steal<py::object>(answer).is(py::bool_(false))
               ? optim::Signal::kStop
               : optim::Signal::kContinue;
  }

  optim::Signal save(const Where& where, bool last) const {
    const py::object save = py::cpp_function([&where] { return dict_of(where()); });
    const py::object is_last = py::bool_(last);
    PyObject* answer = or_wait_for_the_end([&] {
      return PyObject_CallFunctionObjArgs(checkpoint_.ptr(), save.ptr(), is_last.ptr(), nullptr);
    });
    if (answer == nullptr) throw py::error_already_set();
    Py_DECREF(answer);
    return optim::Signal::kContinue;
  }

  py::object callback_, checkpoint_;
  const CommunicatorExchange* ranks_;
  // What came up while a checkpoint was made; it counts at the next iteration.
  optim::Signal asked_ = optim::Signal::kContinue;
  std::exception_ptr error_;
};

// The caller's arrays of unknowns, taken before a solve: what cannot be written is refused then.
class Unknowns {
 public:
  Unknowns(const py::dict& arrays, const ba::Rigs& rigs)
      : cameras_(view<double>(arrays, "cameras")),
        intrinsics_(view<double>(arrays, "intrinsics")),
        points_(view<double>(arrays, "points")) {
    if (rigs.any_free()) sensors_ = view<double>(arrays, "rig_sensors");
  }

  void write(const optim::State& state) const {
    std::copy(state.cameras.begin(), state.cameras.end(), cameras_.begin());
    std::copy(state.intrinsics.begin(), state.intrinsics.end(), intrinsics_.begin());
    std::copy(state.points.begin(), state.points.end(), points_.begin());
    std::copy_n(state.sensors.begin(), sensors_.size(), sensors_.begin());
  }

 private:
  std::span<double> cameras_, intrinsics_, points_, sensors_;  // the last only if any is free
};

ba::SolveSummary solve(const py::dict& arrays,
                       const ba::SolveOptions& options,
                       const py::object& callback,
                       const py::object& checkpoint,
                       const std::optional<py::dict>& resumed,
                       const py::object& ranks) {
  const KeptArrays kept(arrays);
  ba::Problem problem = problem_of(arrays);
  const residuals::ConstraintSet constraints = constraints_of(arrays, problem);
  problem.constraints = &constraints;
  const Unknowns unknowns(arrays, problem.rigs);
  optim::State state = ba::state_of(problem);
  const std::optional<optim::Resumption> before =
      resumed ? std::optional(resumption_of(*resumed)) : std::nullopt;
  auto* const communicator = ranks.is_none() ? nullptr : ranks.cast<CommunicatorExchange*>();
  Exchange& exchange = communicator ? communicator->exchange() : this_process();
  Listener listener(callback, checkpoint, communicator);
  ba::SolveSummary summary = unless_function_failed(problem, [&] {
    const ReleasedGil released;
    return ba::solve(
        problem, options, listener.events(), state, exchange, before ? &*before : nullptr);
  });
  unknowns.write(state);
  listener.rethrow();
  rethrow_failures(problem);
  return summary;
}

py::dict explore_step(const py::dict& arrays,
                      const ba::SolveOptions& options,
                      const std::vector<std::pair<double, double>>& lengths) {
  ba::Problem problem = problem_of(arrays);
  const residuals::ConstraintSet constraints = constraints_of(arrays, problem);
  problem.constraints = &constraints;
  std::vector<optim::StepLengths> pairs;
  pairs.reserve(lengths.size());
  for (const auto& [camera, point] : lengths) pairs.push_back({camera, point});
  const Unknowns unknowns(arrays, problem.rigs);
  optim::State state = ba::state_of(problem);
  const ba::StepExploration found =
      or_failures_of(problem, [&] { return ba::explore_step(problem, options, pairs, state); });
  std::vector<double> algebraic;
  algebraic.reserve(lengths.size());
  for (const auto& [camera, point] : lengths)
    algebraic.push_back(found.algebraic.value(camera, point));
  unknowns.write(state);
  py::dict result;
  result["valid"] = found.valid;
  result["damping"] = found.damping;
  result["geometric"] = found.geometric;
  result["algebraic"] = algebraic;
  result["stationary_lengths"] = found.algebraic.stationary_lengths();
  result["stationary_pairs"] = found.algebraic.stationary_pairs();
  return result;
}

}  // namespace

void bind_solve(py::module_& m) {
  m.def("explore_step",
        &explore_step,
        py::arg("arrays"),
        py::arg("options"),
        py::arg("lengths"),
        "Costs along the first step; the arrays `cameras`, `intrinsics`, `points` and "
        "`rig_sensors` are moved along it at unit length.");
  m.def("solve",
        &solve,
        py::arg("arrays"),
        py::arg("options"),
        py::arg("callback") = py::none(),
        py::arg("checkpoint") = py::none(),
        py::arg("resumed") = py::none(),
        py::arg("exchange") = py::none(),
        "Minimise; the arrays `cameras`, `intrinsics`, `points` and `rig_sensors` are overwritten "
        "with the best state. `checkpoint(where, last)` is called after each iteration; `where()` "
        "gives arrays that another call takes as `resumed`. With `exchange`, this is one rank's "
        "part of a problem.");
}

}  // namespace sfmcpp::bindings

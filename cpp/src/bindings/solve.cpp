#include <algorithm>

#include <pybind11/functional.h>
#include <pybind11/stl.h>

#include "arrays.hpp"
#include "options.hpp"
#include "problem.hpp"

namespace sfmcpp::bindings {
namespace {

// Ctrl-C as Python sees it. Needs the GIL; swallows the KeyboardInterrupt, which the summary
// reports.
bool interrupted() {
  if (PyErr_CheckSignals() == 0) return false;
  if (!PyErr_ExceptionMatches(PyExc_KeyboardInterrupt)) throw py::error_already_set();
  PyErr_Clear();
  return true;
}

// Called without the GIL. A Python exception of the callback ends the solve and is raised after it.
class Listener {
 public:
  explicit Listener(py::object callback) : callback_(std::move(callback)) {}

  optim::Events events() {
    return {.on_iteration =
                [this](const optim::Iteration& i) { return guarded([&] { return call(i); }); },
            .poll = [this] { return guarded([] { return optim::Signal::kContinue; }); }};
  }
  void rethrow() const {
    if (error_) std::rethrow_exception(error_);
  }

 private:
  template <class F>
  optim::Signal guarded(const F& f) {
    const py::gil_scoped_acquire gil;
    try {
      if (interrupted()) return optim::Signal::kInterrupt;
      return f();
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
    return callback_(iteration).is(py::bool_(false)) ? optim::Signal::kStop
                                                     : optim::Signal::kContinue;
  }

  py::object callback_;
  std::exception_ptr error_;
};

ba::SolveSummary solve(const py::dict& arrays,
                       const ba::SolveOptions& options,
                       const py::object& callback) {
  const ba::Problem problem = problem_of(arrays);
  const std::span<double> cameras = view<double>(arrays, "cameras"),
                          intrinsics = view<double>(arrays, "intrinsics"),
                          points = view<double>(arrays, "points");
  optim::State state = ba::state_of(problem);
  Listener listener(callback);
  ba::SolveSummary summary;
  {
    const py::gil_scoped_release release;
    summary = ba::solve(problem, options, listener.events(), state);
    std::copy(state.cameras.begin(), state.cameras.end(), cameras.begin());
    std::copy(state.intrinsics.begin(), state.intrinsics.end(), intrinsics.begin());
    std::copy(state.points.begin(), state.points.end(), points.begin());
  }
  listener.rethrow();
  return summary;
}

}  // namespace

void bind_solve(py::module_& m) {
  m.def("solve",
        &solve,
        py::arg("arrays"),
        py::arg("options"),
        py::arg("callback") = py::none(),
        "Minimise; the arrays `cameras`, `intrinsics` and `points` are overwritten with the best "
        "state.");
}

}  // namespace sfmcpp::bindings

// Functions of the user's own that the core calls, and the GIL that they need, released and taken
// again by threads that may outlive the interpreter.
#pragma once

#include <algorithm>
#include <chrono>
#include <exception>
#include <thread>

#include <pybind11/pybind11.h>

#include "arrays.hpp"

#if defined(__GLIBCXX__)
#include <cxxabi.h>
#endif

namespace sfmcpp::bindings {

// The value of `f`. A daemon thread that asks for the GIL once the interpreter ends must not go on:
// CPython before 3.14 ends it by pthread_exit, whose unwinding no destructor survives and the
// process is aborted. Later versions let such a thread wait for the end of the process, as this
// does. Such an unwinding has no object, and the reference to it is bound to none: inlined, it
// would be checked as the caller is.
template <class F>
#if defined(__GNUC__)
__attribute__((noinline, no_sanitize("null")))
#endif
auto or_wait_for_the_end(const F& f) {
#if defined(__GLIBCXX__)
  try {
    return f();
  } catch (const abi::__forced_unwind&) {
    for (;;) std::this_thread::sleep_for(std::chrono::hours(1));
  }
#else
  return f();
#endif
}

// Also a call guard.
class ReleasedGil {
 public:
  ReleasedGil() : thread_(PyEval_SaveThread()) {}
  ~ReleasedGil() {
    or_wait_for_the_end([this] { PyEval_RestoreThread(thread_); });
  }
  ReleasedGil(const ReleasedGil&) = delete;
  ReleasedGil& operator=(const ReleasedGil&) = delete;

 private:
  PyThreadState* thread_;
};

class HeldGil {
 public:
  HeldGil() : before_(or_wait_for_the_end([] { return PyGILState_Ensure(); })) {}
  ~HeldGil() { PyGILState_Release(before_); }
  HeldGil(const HeldGil&) = delete;
  HeldGil& operator=(const HeldGil&) = delete;

 private:
  PyGILState_STATE before_;
};

// A function of the user. What it raises is kept and its answers are no numbers from then on, which
// ends a solve with the best state so far: whoever started it raises what was kept. It is not
// called again.
class PythonFunction {
 public:
  explicit PythonFunction(py::object function) : function_(std::move(function)) {}

  const std::exception_ptr& failure() const { return failure_; }

  // Calls use(answer) with what the function answers to the arrays that arguments() makes of those
  // in Python; whether neither has failed. Called without the GIL or with it, by one thread at a
  // time.
  template <class Arguments, class Use>
  bool call(const Arguments& arguments, const Use& use) const {
    if (failure_) return false;
    const HeldGil held;
    try {
      const py::tuple given = arguments();
      PyObject* answer =
          or_wait_for_the_end([&] { return PyObject_CallObject(function_.ptr(), given.ptr()); });
      if (answer == nullptr) throw py::error_already_set();
      use(py::reinterpret_steal<py::tuple>(answer));
    } catch (...) {
      failure_ = std::current_exception();
    }
    return !failure_;
  }

 private:
  py::object function_;
  mutable std::exception_ptr failure_;
};

// Of an answer whose shape Python has checked.
inline void copy_answer(const py::handle& value, long size, double* out) {
  const auto array = value.cast<py::array_t<double, py::array::c_style>>();
  if (array.size() != size) throw InvalidArgument("function: the shape of its answer changed");
  std::copy_n(array.data(), size, out);
}

}  // namespace sfmcpp::bindings

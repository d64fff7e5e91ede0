// A function of the user's own that the core calls.
#pragma once

#include <algorithm>
#include <exception>
#include <span>

#include "arrays.hpp"
#include "gil.hpp"

namespace sfmcpp::bindings {

// What it raises is kept and its answers are no numbers from then on, which ends a solve with the
// best state so far: whoever started it raises what was kept. It is not called again.
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

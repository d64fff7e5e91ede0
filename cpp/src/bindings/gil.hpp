// The GIL, released and taken again by threads that may outlive the interpreter.
#pragma once

#include <chrono>
#include <thread>

#include <pybind11/pybind11.h>

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

}  // namespace sfmcpp::bindings

#include "sfmcpp/linear/blas_threads.hpp"

#include <dlfcn.h>
#include <mutex>

namespace sfmcpp::linear {
namespace {

using GetThreads = int (*)();
using SetThreads = void (*)(int);

template <class Function>
Function blas_function(const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_DEFAULT, name));
}

// Looked up once; null where the BLAS is another one.
GetThreads get_threads() {
  static const auto function = blas_function<GetThreads>("openblas_get_num_threads");
  return function;
}
SetThreads set_threads() {
  static const auto function = blas_function<SetThreads>("openblas_set_num_threads");
  return function;
}

// The number of threads is one for all solves of a process: the first holds it, the last gives it
// back.
std::mutex holders_mutex;
int holders = 0;
int previous = 0;

}  // namespace

SingleThreadedBlas::SingleThreadedBlas() {
  if (get_threads() == nullptr || set_threads() == nullptr) return;
  const std::lock_guard lock(holders_mutex);
  if (holders++ > 0) return;
  previous = get_threads()();
  set_threads()(1);
}

SingleThreadedBlas::~SingleThreadedBlas() {
  if (get_threads() == nullptr || set_threads() == nullptr) return;
  const std::lock_guard lock(holders_mutex);
  if (--holders == 0) set_threads()(previous);
}

}  // namespace sfmcpp::linear

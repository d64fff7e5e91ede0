#include "sfmcpp/linear/blas_threads.hpp"

#include <dlfcn.h>

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

}  // namespace

SingleThreadedBlas::SingleThreadedBlas() {
  if (get_threads() == nullptr || set_threads() == nullptr) return;
  previous_ = get_threads()();
  set_threads()(1);
}

SingleThreadedBlas::~SingleThreadedBlas() {
  if (previous_ > 1) set_threads()(previous_);
}

}  // namespace sfmcpp::linear

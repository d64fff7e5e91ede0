#pragma once

namespace sfmcpp::linear {

// Holds OpenBLAS, where that is the BLAS at hand, to one thread for the lifetime of the object.
class SingleThreadedBlas {
 public:
  SingleThreadedBlas();
  ~SingleThreadedBlas();
  SingleThreadedBlas(const SingleThreadedBlas&) = delete;
  SingleThreadedBlas& operator=(const SingleThreadedBlas&) = delete;

 private:
  int previous_ = 0;
};

}  // namespace sfmcpp::linear

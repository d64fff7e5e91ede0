#pragma once

namespace sfmcpp::linear {

// Holds OpenBLAS, where that is the BLAS at hand, to one thread while any such object lives.
class SingleThreadedBlas {
 public:
  SingleThreadedBlas();
  ~SingleThreadedBlas();
  SingleThreadedBlas(const SingleThreadedBlas&) = delete;
  SingleThreadedBlas& operator=(const SingleThreadedBlas&) = delete;
};

}  // namespace sfmcpp::linear

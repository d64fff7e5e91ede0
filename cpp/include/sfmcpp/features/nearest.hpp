// Nearest and second nearest descriptors of a set, by the Euclidean distance, all against all.
#pragma once

#include <cstdint>
#include <vector>

#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/features/nearest_kernels.hpp"

namespace sfmcpp::features {

// `count` rows of `dimension` bytes.
struct Descriptors {
  const std::uint8_t* data;
  int count;
  int dimension;
};

// For each descriptor of one set: its nearest of the other, the lowest of equally near ones, and
// the squared distances to it and to the second nearest; −1 and kPadding where there is none.
struct Neighbours {
  std::vector<int> index, squared_distance, second_squared_distance;
};

struct MutualNeighbours {
  Neighbours of_first, of_second;
};

// Throws InvalidArgument where dimensions differ, or are greater than kMaxDimension.
MutualNeighbours nearest_both_ways(const Descriptors& first,
                                   const Descriptors& second,
                                   ThreadPool& pool,
                                   const NearestKernels& kernels = nearest_kernels());
// That of the first alone, in less time.
Neighbours nearest_of_first(const Descriptors& first,
                            const Descriptors& second,
                            ThreadPool& pool,
                            const NearestKernels& kernels = nearest_kernels());

}  // namespace sfmcpp::features

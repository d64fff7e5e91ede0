#include "sfmcpp/features/nearest.hpp"

#include <algorithm>
#include <limits>

#include "arrays.hpp"
#include "gil.hpp"
#include "options.hpp"

namespace sfmcpp::bindings {
namespace {

using Bytes = py::array_t<std::uint8_t, py::array::c_style>;

// Distances of so many bytes take about as long as a thread needs to be worth it.
constexpr double kProductsOfAThread = 2e7;

features::Descriptors descriptors_of(const Bytes& array, const char* name) {
  if (array.ndim() != 2) throw InvalidArgument(std::string(name) + ": must have two dimensions");
  constexpr py::ssize_t kMost = std::numeric_limits<int>::max() / 2;
  if (array.shape(0) > kMost || array.shape(1) > features::kMaxDimension) {
    throw InvalidArgument(std::string(name) + ": of " + std::to_string(array.shape(0)) + " × " +
                          std::to_string(array.shape(1)) + " elements, must be of at most " +
                          std::to_string(kMost) + " × " + std::to_string(features::kMaxDimension));
  }
  return {array.data(), static_cast<int>(array.shape(0)), static_cast<int>(array.shape(1))};
}

int threads_for(int requested, const features::Descriptors& a, const features::Descriptors& b) {
  if (requested > 0) return requested;
  const double products = static_cast<double>(a.count) * b.count * a.dimension;
  const auto worthwhile = static_cast<int>(std::min(products / kProductsOfAThread, 64.0));
  return std::min(std::max(worthwhile, 1),
                  resolve_num_threads(0, std::numeric_limits<long>::max()));
}

py::tuple tuple_of(const features::Neighbours& neighbours) {
  return py::make_tuple(array_of(neighbours.index),
                        array_of(neighbours.squared_distance),
                        array_of(neighbours.second_squared_distance));
}

py::tuple nearest_of_first(const Bytes& first, const Bytes& second, int threads) {
  const features::Descriptors a = descriptors_of(first, "first"),
                              b = descriptors_of(second, "second");
  features::Neighbours result;
  {
    const ReleasedGil released;
    ThreadPool pool(threads_for(threads, a, b));
    result = features::nearest_of_first(a, b, pool);
  }
  return tuple_of(result);
}

py::tuple nearest_both_ways(const Bytes& first, const Bytes& second, int threads) {
  const features::Descriptors a = descriptors_of(first, "first"),
                              b = descriptors_of(second, "second");
  features::MutualNeighbours result;
  {
    const ReleasedGil released;
    ThreadPool pool(threads_for(threads, a, b));
    result = features::nearest_both_ways(a, b, pool);
  }
  return py::make_tuple(tuple_of(result.of_first), tuple_of(result.of_second));
}

}  // namespace

void bind_nearest(py::module_& m) {
  m.def(
      "nearest_of_first",
      &nearest_of_first,
      py::arg("first").noconvert(),
      py::arg("second").noconvert(),
      py::arg("threads") = 0,
      "Nearest of `second` to each of `first`: its number (-1: none), the squared distances to it "
      "and to the second nearest (2**29: none).");
  m.def("nearest_both_ways",
        &nearest_both_ways,
        py::arg("first").noconvert(),
        py::arg("second").noconvert(),
        py::arg("threads") = 0,
        "What nearest_of_first says of each, and what it says with both exchanged, at once.");
}

}  // namespace sfmcpp::bindings

#include <algorithm>
#include <limits>
#include <string>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include "arrays.hpp"
#include "module.hpp"
#include "python_function.hpp"
#include "sfmcpp/core/error.hpp"
#include "sfmcpp/features/nearest.hpp"
#include "sfmcpp/features/patches.hpp"

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
  const KeptArrays kept(first, second);
  features::Neighbours result;
  {
    const ReleasedGil released;
    const BorrowedPool borrowed(threads_for(threads, a, b));
    result = features::nearest_of_first(a, b, *borrowed);
  }
  return tuple_of(result);
}

py::tuple nearest_both_ways(const Bytes& first, const Bytes& second, int threads) {
  const features::Descriptors a = descriptors_of(first, "first"),
                              b = descriptors_of(second, "second");
  const KeptArrays kept(first, second);
  features::MutualNeighbours result;
  {
    const ReleasedGil released;
    const BorrowedPool borrowed(threads_for(threads, a, b));
    result = features::nearest_both_ways(a, b, *borrowed);
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

namespace {

template <class T>
using Array = py::array_t<T, py::array::c_style>;
using Images = std::vector<Array<float>>;

std::vector<features::GreyLevel> pyramid_of(const Images& images) {
  std::vector<features::GreyLevel> levels;
  for (const Array<float>& image : images) {
    if (image.ndim() != 2 || image.shape(0) < 2 || image.shape(1) < 2)
      throw InvalidArgument("levels: each must have two dimensions of at least 2");
    levels.push_back(
        {image.data(), static_cast<int>(image.shape(1)), static_cast<int>(image.shape(0))});
  }
  return levels;
}

template <class T>
void require_shape(const Array<T>& array, const char* name, const std::vector<py::ssize_t>& shape) {
  if (std::vector<py::ssize_t>(array.shape(), array.shape() + array.ndim()) != shape)
    throw InvalidArgument(std::string(name) + ": wrong shape");
}

std::vector<features::PatchPlace> places_of(const Array<double>& centres,
                                            const Array<double>& steps,
                                            const Array<int>& level,
                                            std::size_t num_levels) {
  const py::ssize_t count = level.size();
  require_shape(level, "level", {count});
  require_shape(centres, "centres", {count, 2});
  require_shape(steps, "steps", {count, 2, 2});
  std::vector<features::PatchPlace> places(count);
  for (py::ssize_t k = 0; k < count; ++k) {
    const double *centre = centres.data() + 2 * k, *step = steps.data() + 4 * k;
    places[k] = {{centre[0], centre[1]}, {step[0], step[1], step[2], step[3]}, level.data()[k]};
    if (places[k].level < 0 || static_cast<std::size_t>(places[k].level) >= num_levels)
      throw InvalidArgument("level: must be from 0 to " + std::to_string(num_levels - 1));
  }
  return places;
}

void require_radius(py::ssize_t radius) {
  if (radius < 1 || radius > features::kMaxPatchRadius) {
    throw InvalidArgument("radius = " + std::to_string(radius) + ": must be from 1 to " +
                          std::to_string(features::kMaxPatchRadius));
  }
}

Array<float> sample_patches(const Images& images,
                            const Array<double>& centres,
                            const Array<double>& steps,
                            const Array<int>& level,
                            int radius) {
  require_radius(radius);
  const std::vector<features::GreyLevel> pyramid = pyramid_of(images);
  const auto places = places_of(centres, steps, level, pyramid.size());
  const py::ssize_t side = features::patch_side(radius);
  Array<float> samples({static_cast<py::ssize_t>(places.size()), side, side});
  float* out = samples.mutable_data();
  const KeptArrays kept(images);
  const ReleasedGil released;
  for (const features::PatchPlace& place : places) {
    if (!features::sample_patch(pyramid, place, radius, out))
      std::fill_n(out, side * side, std::numeric_limits<float>::quiet_NaN());
    out += side * side;
  }
  return samples;
}

py::tuple align_patches(const Images& images,
                        const Array<float>& templates,
                        const Array<int>& which,
                        const Array<double>& centres,
                        const Array<double>& steps,
                        const Array<int>& level) {
  if (templates.ndim() != 3) throw InvalidArgument("templates: must have three dimensions");
  const py::ssize_t side = templates.shape(1), num_templates = templates.shape(0);
  require_shape(templates, "templates", {num_templates, side, side});
  require_radius((side - 3) / 2);
  if (side % 2 == 0) throw InvalidArgument("templates: must have an odd number of rows");
  const std::vector<features::GreyLevel> pyramid = pyramid_of(images);
  const auto places = places_of(centres, steps, level, pyramid.size());
  const auto count = static_cast<py::ssize_t>(places.size());
  require_shape(which, "which", {count});
  for (py::ssize_t k = 0; k < count; ++k) {
    if (which.data()[k] < 0 || which.data()[k] >= num_templates)
      throw InvalidArgument("which: must be from 0 to " + std::to_string(num_templates - 1));
  }
  Array<double> found({count, py::ssize_t{2}}), correlations(count),
      covariances({count, py::ssize_t{3}});
  double *centre = found.mutable_data(), *correlation = correlations.mutable_data(),
         *covariance = covariances.mutable_data();
  const KeptArrays kept(images, templates, which);
  {
    const ReleasedGil released;
    features::PatchAligner aligner(static_cast<int>((side - 3) / 2));
    for (py::ssize_t k = 0; k < count; ++k) {
      const float* templ = templates.data() + which.data()[k] * side * side;
      const features::Alignment one = aligner.align(pyramid, templ, places[k]);
      std::copy_n(one.centre.data(), 2, centre + 2 * k);
      std::copy_n(one.covariance.data(), 3, covariance + 3 * k);
      correlation[k] = one.correlation;
    }
  }
  return py::make_tuple(found, correlations, covariances);
}

}  // namespace

void bind_patches(py::module_& m) {
  m.def("sample_patches",
        &sample_patches,
        py::arg("levels"),
        py::arg("centres"),
        py::arg("steps"),
        py::arg("level"),
        py::arg("radius"),
        "Patches (n, 2 radius + 1, 2 radius + 1) of an image; not a number where they are not all "
        "within it.");
  m.def("align_patches",
        &align_patches,
        py::arg("levels"),
        py::arg("templates"),
        py::arg("which"),
        py::arg("centres"),
        py::arg("steps"),
        py::arg("level"),
        "Where an image looks like templates: centres (n, 2), correlations (n) (-1: nowhere near) "
        "and covariances (n, 3).");
}

}  // namespace sfmcpp::bindings

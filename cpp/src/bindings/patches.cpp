#include "sfmcpp/features/patches.hpp"

#include <limits>
#include <string>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include "gil.hpp"
#include "options.hpp"
#include "sfmcpp/core/error.hpp"

namespace sfmcpp::bindings {
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

#include "problem.hpp"

#include "arrays.hpp"

namespace sfmcpp::bindings {
namespace {

std::span<const std::uint8_t> flags(const py::dict& arrays, const char* name) {
  const std::span<const bool> values = view<const bool>(arrays, name);
  static_assert(sizeof(bool) == sizeof(std::uint8_t));
  return {reinterpret_cast<const std::uint8_t*>(values.data()), values.size()};
}

}  // namespace

ba::Problem problem_of(const py::dict& arrays) {
  ba::Problem problem;
  problem.camera_model = parse_enum<CameraModelId>(arrays["camera_model"].cast<std::string>());
  problem.cameras = view<const double>(arrays, "cameras");
  problem.intrinsics = view<const double>(arrays, "intrinsics");
  problem.points = view<const double>(arrays, "points");
  problem.intrinsics_index = view<const int>(arrays, "intrinsics_index");
  problem.camera_index = view<const int>(arrays, "camera_index");
  problem.point_index = view<const int>(arrays, "point_index");
  problem.pixels = view<const double>(arrays, "pixels");
  if (!arrays["sigma_px"].is_none()) problem.sigma_px = view<const double>(arrays, "sigma_px");
  problem.fixed_cameras = flags(arrays, "fixed_cameras");
  problem.fixed_points = flags(arrays, "fixed_points");
  problem.fixed_intrinsics = flags(arrays, "fixed_intrinsics");
  return problem;
}

}  // namespace sfmcpp::bindings

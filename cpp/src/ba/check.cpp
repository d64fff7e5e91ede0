#include "sfmcpp/ba/check.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>

#include <Eigen/LU>

#include "sfmcpp/cameras/pose.hpp"
#include "sfmcpp/core/disjoint_sets.hpp"
#include "sfmcpp/core/error.hpp"
#include "sfmcpp/math/so3.hpp"
#include "sfmcpp/residuals/whitening.hpp"

namespace sfmcpp::ba {
namespace {

std::string short_text(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.9g", value);
  return text;
}

[[noreturn]] void refuse_size(const char* array, std::size_t size, const std::string& rule) {
  throw InvalidArgument(std::string(array) + ": " + std::to_string(size) + " values, must be " +
                        rule);
}

// "pixels: 6 values, must be 8: 2 for each of 4 observations".
void check_size(
    const char* array, std::size_t size, std::size_t width, std::size_t count, const char* owners) {
  if (size == width * count) return;
  refuse_size(array,
              size,
              std::to_string(width * count) + ": " + std::to_string(width) + " for each of " +
                  std::to_string(count) + " " + owners);
}

// Of arrays that may be empty.
void check_size_if_given(
    const char* array, std::size_t size, std::size_t width, std::size_t count, const char* owners) {
  if (size != 0) check_size(array, size, width, count, owners);
}

// Of arrays that say how many owners there are.
void check_multiple(const char* array, std::size_t size, std::size_t width, const char* owner) {
  if (size % width == 0) return;
  refuse_size(
      array, size, "a multiple of " + std::to_string(width) + ", as a " + owner + " has so many");
}

void check_model(const CameraModel& model) {
  if (model.function() == nullptr) {
    if (is_enumerator(model.compiled())) return;
    throw InvalidArgument("camera_model = " + std::to_string(static_cast<int>(model.compiled())) +
                          ": is none of its values");
  }
  constexpr std::size_t kMostIntrinsics = linear::kMaxCameraSize - kPoseTangent;
  const std::size_t count = model.function()->intrinsic_names().size();
  if (count >= 1 && count <= kMostIntrinsics) return;
  throw InvalidArgument("camera_model '" + std::string(model.name()) +
                        "': " + std::to_string(count) + " intrinsics, must be 1 to " +
                        std::to_string(kMostIntrinsics));
}

// Without a branch, so that whole vectors of numbers are looked at together: what is not finite has
// all bits of the exponent set.
bool all_finite(std::span<const double> values) {
  constexpr std::uint64_t kExponent = 0x7ff0000000000000;
  std::uint64_t found = 0;
  for (double value : values) {
    const std::uint64_t exponent = std::bit_cast<std::uint64_t>(value) & kExponent;
    found |= static_cast<std::uint64_t>(exponent == kExponent);
  }
  return found == 0;
}

// `width` numbers belong to one camera, point, …: the message names its position.
void check_finite(const char* array, std::span<const double> values, std::size_t width) {
  if (all_finite(values)) return;
  for (std::size_t k = 0; k < values.size(); ++k) {
    if (!std::isfinite(values[k])) {
      throw InvalidArgument(entry(array, k / width) + " = " + short_text(values[k]) +
                            ": must be finite");
    }
  }
}

void check_range(const char* array, std::span<const int> values, int end) {
  unsigned largest = 0;  // of negative numbers too
  for (int value : values) largest = std::max(largest, static_cast<unsigned>(value));
  if (values.empty() || (end > 0 && largest < static_cast<unsigned>(end))) return;
  for (std::size_t k = 0; k < values.size(); ++k) {
    if (values[k] < 0 || values[k] >= end) {
      throw InvalidArgument(entry(array, k) + " = " + std::to_string(values[k]) +
                            ": must be in [0, " + std::to_string(end) + ")");
    }
  }
}

void check_rotations(const Problem& problem) {
  for (int i = 0; i < problem.num_cameras(); ++i) {
    const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> camera(
        problem.cameras.data() + problem.camera_offset(i));
    const Eigen::Matrix3d r = camera.leftCols<3>();
    if (!is_rotation(r)) {
      const double error = (r * r.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
      throw InvalidArgument(entry("cameras", static_cast<std::size_t>(i)) +
                            ": not a rotation: |R Rᵀ − I| = " + short_text(error) +
                            ", determinant " + short_text(r.determinant()) +
                            "; must be orthonormal to 1e-6 with determinant 1");
    }
  }
}

void check_sigma(std::span<const double> sigma) {
  for (std::size_t k = 0; k < sigma.size(); ++k) {
    if (!(sigma[k] > 0.0)) {
      throw InvalidArgument(entry("sigma_px", k) + " = " + short_text(sigma[k]) +
                            ": must be positive");
    }
  }
}

// Homogeneous coordinates that are all zero are no point and no camera.
void check_scales(const char* array, std::span<const double> values, std::size_t width) {
  for (std::size_t first = 0; first < values.size(); first += width) {
    const auto block = values.subspan(first, width);
    if (std::all_of(block.begin(), block.end(), [](double x) { return x == 0.0; }))
      throw InvalidArgument(entry(array, first / width) + ": homogeneous, must not be all zero");
  }
}

void check_frames(const Problem& problem) {
  const auto width = static_cast<std::size_t>(problem.num_intrinsics());
  for (std::size_t k = 0; k < problem.intrinsics.size(); k += width) {
    if (!(problem.intrinsics[k] > 0.0))
      throw InvalidArgument(entry("intrinsics", k / width) + ": scale = " +
                            short_text(problem.intrinsics[k]) + ": must be positive");
  }
}

// "camera 3", "cameras 3, 7", "120 cameras (3, 7, 9, 12, 15, …)".
std::string name_list(const char* what, const std::vector<int>& numbers) {
  constexpr std::size_t kNamed = 5;
  std::string list;
  for (std::size_t k = 0; k < std::min(numbers.size(), kNamed); ++k) {
    list += (k == 0 ? "" : ", ") + std::to_string(numbers[k]);
  }
  if (numbers.size() == 1) return std::string(what) + " " + list;
  if (numbers.size() <= kNamed) return std::string(what) + "s " + list;
  return std::to_string(numbers.size()) + " " + what + "s (" + list + ", …)";
}

template <class Predicate>
void warn(const char* what,
          int count,
          const Predicate& applies,
          const char* text,
          std::vector<std::string>& warnings) {
  std::vector<int> numbers;
  for (int k = 0; k < count; ++k) {
    if (applies(k)) numbers.push_back(k);
  }
  if (!numbers.empty()) warnings.push_back(name_list(what, numbers) + ": " + text);
}

// Joins the cameras of each point of this rank; done as soon as those with observations are one.
DisjointSets parts_here(const linear::ObservationGraph& graph) {
  DisjointSets parts(graph.num_cameras);
  int unobserved = 0;
  for (int i = 0; i < graph.num_cameras; ++i) unobserved += graph.observations_of_camera(i) == 0;
  for (int p = 0; p < graph.num_points && parts.count() > unobserved + 1; ++p) {
    for (int k = graph.point_begin[p] + 1; k < graph.point_begin[p + 1]; ++k)
      parts.join(graph.camera[graph.of_point[k]], graph.camera[graph.of_point[k - 1]]);
  }
  return parts;
}

// Joins the cameras of each frame.
void join_frames(std::span<const int> frame_of_camera, DisjointSets& parts) {
  std::vector<int> first(frame_of_camera.size(), -1);
  for (int i = 0; i < static_cast<int>(frame_of_camera.size()); ++i) {
    int& of_frame = first[frame_of_camera[i]];
    if (of_frame < 0) of_frame = i;
    parts.join(i, of_frame);
  }
}

// Cameras joined through common points, of any rank, and through rigs.
int num_components(const linear::ObservationGraph& graph, const Rigs& rigs, Exchange& exchange) {
  const int cameras = graph.num_cameras;
  DisjointSets here = parts_here(graph), joined(cameras);
  std::vector<double> roots(cameras);
  for (int i = 0; i < cameras; ++i) roots[i] = here.root(i);
  const std::vector<double> all = exchange.gather(roots);
  for (std::size_t k = 0; k < all.size(); ++k)
    joined.join(static_cast<int>(k % roots.size()), static_cast<int>(all[k]));
  join_frames(rigs.frame_of_camera, joined);
  std::vector<char> is_component(cameras, 0);
  for (int i = 0; i < cameras; ++i) {
    if (graph.is_observed(i)) is_component[joined.root(i)] = 1;
  }
  return static_cast<int>(std::ranges::count(is_component, 1));
}

Eigen::Vector3d centre_of(const Problem& problem, int camera) {
  const double* pose = problem.cameras.data() + problem.camera_offset(camera);
  return {pose[3], pose[7], pose[11]};
}

// Whether several cameras see a point, all from one place: rays that differ by rounding alone.
bool lacks_baseline(const Problem& problem, const linear::ObservationGraph& graph, int p) {
  constexpr double kSmallestAngle = 1e-9;
  const int begin = graph.point_begin[p], end = graph.point_begin[p + 1];
  if (end - begin < 2) return false;
  const Eigen::Vector3d first = centre_of(problem, graph.camera[graph.of_point[begin]]);
  const Eigen::Map<const Eigen::Vector3d> point(problem.points.data() + problem.point_offset(p));
  const double negligible = kSmallestAngle * (point - first).norm();
  for (int k = begin + 1; k < end; ++k) {
    const Eigen::Vector3d other = centre_of(problem, graph.camera[graph.of_point[k]]);
    if ((other - first).norm() > negligible) return false;
  }
  return true;
}

bool is_of_images_alone(std::span<const char> of_others, int p) {
  return of_others.empty() || of_others[p] == 0;
}

}  // namespace

void check_sizes(const Problem& problem) {
  check_model(problem.camera_model);
  const auto width = static_cast<std::size_t>(problem.num_intrinsics());
  check_multiple("cameras", problem.cameras.size(), kCameraStorage, "camera");
  check_multiple("intrinsics", problem.intrinsics.size(), width, "row of intrinsics");
  check_multiple(
      "points", problem.points.size(), static_cast<std::size_t>(problem.point_storage()), "point");
  const auto cameras = static_cast<std::size_t>(problem.num_cameras());
  const auto points = static_cast<std::size_t>(problem.num_points());
  const auto rows = static_cast<std::size_t>(problem.num_groups());
  const std::size_t observations = problem.camera_index.size();
  const char* const of_observations = "observations in camera_index";
  check_size("intrinsics_index", problem.intrinsics_index.size(), 1, cameras, "cameras");
  check_size("point_index", problem.point_index.size(), 1, observations, of_observations);
  check_size("pixels", problem.pixels.size(), 2, observations, of_observations);
  check_size_if_given("sigma_px", problem.sigma_px.size(), 1, observations, of_observations);
  check_size_if_given("fixed_cameras", problem.fixed_cameras.size(), 1, cameras, "cameras");
  check_size_if_given("fixed_points", problem.fixed_points.size(), 1, points, "points");
  check_size_if_given(
      "fixed_intrinsics", problem.fixed_intrinsics.size(), width, rows, "rows of intrinsics");
}

void check_indices(const Problem& problem) {
  check_range("intrinsics_index", problem.intrinsics_index, problem.num_groups());
  check_range("camera_index", problem.camera_index, problem.num_cameras());
  check_range("point_index", problem.point_index, problem.num_points());
}

void check_values(const Problem& problem) {
  check_finite("cameras", problem.cameras, kCameraStorage);
  check_finite(
      "intrinsics", problem.intrinsics, static_cast<std::size_t>(problem.num_intrinsics()));
  check_finite("points", problem.points, static_cast<std::size_t>(problem.point_storage()));
  check_finite("pixels", problem.pixels, 2);
  check_finite("sigma_px", problem.sigma_px, 1);
  check_sigma(problem.sigma_px);
  residuals::check_covariances(
      problem.sigma_px, problem.covariance_px2, problem.camera_index.size());
  if (is_metric(problem.camera_model)) {
    check_rotations(problem);
  } else {
    check_scales("cameras", problem.cameras, kCameraStorage);
    check_scales("points", problem.points, static_cast<std::size_t>(problem.point_storage()));
    check_frames(problem);
  }
}

void check_arrays(const Problem& problem) {
  check_sizes(problem);
  check_indices(problem);
  check_values(problem);
}

void check_duplicates(const Problem& problem, const linear::ObservationGraph& graph) {
  bool found = false;
  for (int k = 1; k < problem.num_observations(); ++k)
    found |= (graph.camera[k] == graph.camera[k - 1]) & (graph.point[k] == graph.point[k - 1]);
  if (!found) return;
  for (int k = 1; k < problem.num_observations(); ++k) {
    if (graph.camera[k] != graph.camera[k - 1] || graph.point[k] != graph.point[k - 1]) continue;
    throw InvalidArgument("observations " + std::to_string(graph.source[k - 1]) + " and " +
                          std::to_string(graph.source[k]) + " are both of point " +
                          std::to_string(graph.point[k]) + " in camera " +
                          std::to_string(graph.camera[k]) + ": must be one");
  }
}

void check_determined(const linear::ObservationGraph& graph,
                      const linear::ParameterMap& map,
                      long constraint_equations,
                      Exchange& exchange) {
  const auto free_points = std::count(map.free_point.begin(), map.free_point.end(), 1);
  const auto observed = static_cast<long>(exchange.sum(2.0 * graph.num_observations()));
  const long residuals = observed + constraint_equations;
  const long unknowns =
      map.num_columns + static_cast<long>(exchange.sum(3.0 * static_cast<double>(free_points)));
  if (observed == 0) throw InvalidArgument("observations: there are none");
  if (unknowns == 0)
    throw InvalidArgument("nothing is free: every observed camera, intrinsic and point is fixed");
  if (residuals < unknowns) {
    throw InvalidArgument("fewer residuals than unknowns: " + std::to_string(residuals) +
                          " residuals, " + std::to_string(unknowns) +
                          " unknowns; fix some or add observations");
  }
}

std::vector<std::string> warnings_about(const linear::ObservationGraph& graph,
                                        const Rigs& rigs,
                                        bool constrained,
                                        Exchange& exchange,
                                        std::span<const char> of_others) {
  std::vector<std::string> warnings;
  const auto has_views = [&](int p, int count) {
    return is_of_images_alone(of_others, p) && graph.observations_of_point(p) == count;
  };
  warn(
      "camera",
      graph.num_cameras,
      [&](int i) { return !graph.takes_part(i); },
      "no observations, left as given",
      warnings);
  warn(
      "point",
      graph.num_points,
      [&](int p) { return has_views(p, 0); },
      "no observations, left as given",
      warnings);
  warn(
      "point",
      graph.num_points,
      [&](int p) { return has_views(p, 1); },
      "seen by one camera only, the depth is held by damping alone",
      warnings);
  const int components = num_components(graph, rigs, exchange);
  if (components > 1) {
    warnings.push_back(
        "the cameras fall into " + std::to_string(components) + " parts that share no point: " +
        (constrained ? "only the constraints hold their relative position, rotation and scale"
                     : "their relative position, rotation and scale are arbitrary"));
  }
  return warnings;
}

std::vector<std::string> warnings_about_baselines(const Problem& problem,
                                                  const linear::ObservationGraph& graph,
                                                  std::span<const char> of_others) {
  std::vector<std::string> warnings;
  if (!is_metric(problem.camera_model)) return warnings;
  warn(
      "point",
      graph.num_points,
      [&](int p) { return is_of_images_alone(of_others, p) && lacks_baseline(problem, graph, p); },
      "seen from one place, the depth is held by damping alone",
      warnings);
  return warnings;
}

}  // namespace sfmcpp::ba

#include "sfmcpp/ba/check.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>

#include <Eigen/LU>

#include "sfmcpp/ba/gauge.hpp"
#include "sfmcpp/cameras/matrix34.hpp"
#include "sfmcpp/cameras/pose.hpp"
#include "sfmcpp/core/error.hpp"
#include "sfmcpp/math/decompositions.hpp"
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

// Cameras, points and observations are numbered by int.
void check_count(const char* array, std::size_t size, std::size_t width) {
  constexpr std::size_t kLargestInt = std::numeric_limits<int>::max();
  if (size / width > kLargestInt)
    refuse_size(
        array, size, "at most " + std::to_string(width) + " · " + std::to_string(kLargestInt));
}

// Of arrays that say how many owners there are.
void check_multiple(const char* array, std::size_t size, std::size_t width, const char* owner) {
  check_count(array, size, width);
  if (size % width == 0) return;
  refuse_size(
      array, size, "a multiple of " + std::to_string(width) + ", as a " + owner + " has so many");
}

void check_model(const CameraModel& model) {
  if (model.function() == nullptr) {
    if (is_enumerator(model.compiled())) return;
    if (model.compiled() == CameraModelId::kPlugin)
      throw InvalidArgument(
          "camera_model = kPlugin: sfmcpp was built without a model of its own "
          "(SFMCPP_CAMERA_PLUGIN)");
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
    const PoseMatrixView camera(problem.cameras.data() + problem.camera_offset(i));
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

// Of the homographies exp(A) of a projective world, those that do not change what is fixed and
// seen: P A ~ P of cameras, A Q ~ Q of points, which are linear in the 16 entries of A. All are so
// for A = I, which is no motion.
class FreeHomographies {
 public:
  void hold_camera(const Matrix34& p) {
    Eigen::Matrix<double, 12, 16> moved = Eigen::Matrix<double, 12, 16>::Zero();
    for (int c = 0; c < 4; ++c) moved.block<3, 4>(3 * c, 4 * c) = p;
    const Eigen::Matrix<double, 3, 4> by_columns = p;
    hold(moved, by_columns.reshaped());
  }
  void hold_point(const Eigen::Vector4d& q) {
    Eigen::Matrix<double, 4, 16> moved;
    for (int c = 0; c < 4; ++c) moved.middleCols<4>(4 * c) = q[c] * Eigen::Matrix4d::Identity();
    hold(moved, q);
  }
  // Over all ranks.
  long count(Exchange& exchange) {
    constexpr double kNegligible = 1e-12;
    exchange.sum({held_.data(), static_cast<std::size_t>(held_.size())});
    const Eigen::VectorXd values = symmetric_spectrum(held_).values;
    return (values.array() <= kNegligible * std::max(values[15], 1.0)).count() - 1;
  }

 private:
  template <class Moved, class Block>
  void hold(const Moved& moved, const Block& block) {
    const auto along = block.normalized().eval();
    const Moved aside = (moved - along * (along.transpose() * moved)) / block.norm();
    held_ += aside.transpose() * aside;
  }

  Eigen::Matrix<double, 16, 16> held_ = Eigen::Matrix<double, 16, 16>::Zero();
};

long num_free_homographies(const Problem& problem,
                           const linear::ObservationGraph& graph,
                           const optim::State& state,
                           Exchange& exchange) {
  FreeHomographies free;
  for (int i = 0; i < problem.num_cameras() && exchange.is_root(); ++i) {
    if (graph.is_observed(i) && problem.is_fixed_camera(i))
      free.hold_camera(PoseMatrixView(state.cameras.data() + problem.camera_offset(i)));
  }
  for (int p = 0; p < problem.num_points(); ++p) {
    if (graph.observations_of_point(p) > 0 && problem.is_fixed_point(p))
      free.hold_point(Eigen::Vector4d(state.points.data() + problem.point_offset(p)));
  }
  return free.count(exchange);
}

void check_frames(const Problem& problem) {
  const auto width = static_cast<std::size_t>(problem.num_intrinsics());
  for (std::size_t k = 0; k < problem.intrinsics.size(); k += width) {
    if (!(problem.intrinsics[k] > 0.0))
      throw InvalidArgument(entry("intrinsics", k / width) + ": scale = " +
                            short_text(problem.intrinsics[k]) + ": must be positive");
  }
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
  check_count("camera_index", observations, 1);
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
  int found = 0;
  for (int k = 1; k < problem.num_observations(); ++k) {
    const int same_camera = graph.camera[k] == graph.camera[k - 1];
    const int same_point = graph.point[k] == graph.point[k - 1];
    found |= same_camera & same_point;  // without a branch: compilers take several at once
  }
  if (found == 0) return;
  for (int k = 1; k < problem.num_observations(); ++k) {
    if (graph.camera[k] != graph.camera[k - 1] || graph.point[k] != graph.point[k - 1]) continue;
    throw InvalidArgument("observations " + std::to_string(graph.source[k - 1]) + " and " +
                          std::to_string(graph.source[k]) + " are both of point " +
                          std::to_string(graph.point[k]) + " in camera " +
                          std::to_string(graph.camera[k]) + ": must be one");
  }
}

long num_world_freedoms(const Problem& problem,
                        const linear::ObservationGraph& graph,
                        const optim::State& state,
                        Exchange& exchange) {
  if (is_metric(problem.camera_model))
    return static_cast<long>(choose_gauge(problem, graph, state, exchange).size());
  long scales = 0;  // of matrices, each with a column
  for (int i = 0; i < problem.num_cameras(); ++i)
    scales += graph.is_observed(i) && !problem.is_fixed_camera(i);
  return scales + num_free_homographies(problem, graph, state, exchange);
}

void check_determined(const linear::ObservationGraph& graph,
                      const linear::ParameterMap& map,
                      long constraint_equations,
                      Exchange& exchange,
                      const std::function<long()>& world_freedoms) {
  const auto free_points = std::count(map.free_point.begin(), map.free_point.end(), 1);
  const auto observed = static_cast<long>(exchange.sum(2.0 * graph.num_observations()));
  const long residuals = observed + constraint_equations;
  const long unknowns =
      map.num_columns + static_cast<long>(exchange.sum(3.0 * static_cast<double>(free_points)));
  if (observed == 0)
    throw InvalidArgument(
        "observations: there are none; constraints alone, a graph of poses, are not adjusted");
  if (unknowns == 0)
    throw InvalidArgument("nothing is free: every observed camera, intrinsic and point is fixed");
  if (residuals >= unknowns) return;
  const long freedoms = world_freedoms(), told = unknowns - freedoms;
  if (residuals < told) {
    throw InvalidArgument("fewer residuals than unknowns: " + std::to_string(residuals) +
                          " residuals, " + std::to_string(told) + " unknowns" +
                          (freedoms == 0
                               ? std::string()
                               : " beside the " + std::to_string(freedoms) +
                                     (freedoms == 1 ? " freedom" : " freedoms") + " of the world") +
                          "; fix some or add observations");
  }
}

}  // namespace sfmcpp::ba

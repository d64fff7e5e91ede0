// Warnings: what is legal about a problem but doubtful, naming cameras and points.
#include <algorithm>
#include <cmath>
#include <optional>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "sfmcpp/ba/check.hpp"
#include "sfmcpp/core/grouping.hpp"
#include "sfmcpp/residuals/whitening.hpp"

namespace sfmcpp::ba {
namespace {

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
DisjointSets parts_of(const linear::ObservationGraph& graph, const Rigs& rigs, Exchange& exchange) {
  const int cameras = graph.num_cameras;
  DisjointSets here = parts_here(graph), joined(cameras);
  std::vector<double> roots(cameras);
  for (int i = 0; i < cameras; ++i) roots[i] = here.root(i);
  const std::vector<double> all = exchange.gather(roots);
  for (std::size_t k = 0; k < all.size(); ++k)
    joined.join(static_cast<int>(k % roots.size()), static_cast<int>(all[k]));
  join_frames(rigs.frame_of_camera, joined);
  return joined;
}

// What is fixed of a part: cameras, and points that it sees.
struct Part {
  double cameras = 0.0, points = 0.0;

  bool has_any() const { return cameras + points > 0.0; }
  // Whether that can hold it in the world, unless it lies unfavourably: seven freedoms, or the
  // fifteen of a projective world, of which a point takes three and a camera eleven.
  bool is_held(bool metric) const {
    if (cameras >= 2.0) return true;
    if (cameras == 1.0) return points >= (metric ? 1.0 : 4.0);
    return points >= (metric ? 3.0 : 5.0);
  }
};

// Of the cameras with observations.
std::vector<Part> fixed_in_parts(const linear::ObservationGraph& graph,
                                 DisjointSets joined,
                                 const Anchors& anchors,
                                 Exchange& exchange) {
  const auto cameras = static_cast<std::size_t>(graph.num_cameras);
  std::vector<double> points(cameras);
  for (std::size_t p = 0; p < anchors.fixed_points.size(); ++p) {
    if (anchors.fixed_points[p] != 0 && graph.observations_of_point(static_cast<int>(p)) > 0)
      points[joined.root(graph.camera[graph.of_point[graph.point_begin[p]]])] += 1.0;
  }
  exchange.sum(points);
  std::vector<Part> of_root(cameras);
  std::vector<char> is_part(cameras);
  for (int i = 0; i < graph.num_cameras; ++i) {
    Part& part = of_root[joined.root(i)];
    is_part[joined.root(i)] |= static_cast<char>(graph.is_observed(i));
    part.points = points[joined.root(i)];
    part.cameras += !anchors.fixed_cameras.empty() && anchors.fixed_cameras[i] != 0;
  }
  std::vector<Part> parts;
  for (std::size_t i = 0; i < cameras; ++i) {
    if (is_part[i]) parts.push_back(of_root[i]);
  }
  return parts;
}

// What relates parts that share no point.
std::string relation_of(const std::vector<Part>& parts, const Anchors& anchors) {
  const bool fixed = std::ranges::count_if(parts, &Part::has_any) > 1;
  if (anchors.constrained)
    return fixed ? "nothing but constraints, fixed cameras and fixed points relates them"
                 : "nothing but constraints relates them";
  if (!fixed) return "their relative position, rotation and scale are arbitrary";
  const auto held = std::ranges::count_if(
      parts, [&](const Part& part) { return part.is_held(anchors.is_metric); });
  if (held == std::ssize(parts)) return "nothing but fixed cameras and fixed points relates them";
  return "fixed cameras and fixed points hold " + std::to_string(held) +
         " of them; the position, rotation or scale of the others is arbitrary";
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

// Squared sine of the angle between two rays.
double squared_sine(const Eigen::Vector3d& one, const Eigen::Vector3d& other) {
  return one.cross(other).squaredNorm() / (one.squaredNorm() * other.squaredNorm());
}

// Whether the rays of several cameras to a point differ by no more than `limit` standard deviations
// of the first observation.
bool lacks_parallax(const Problem& problem,
                    const linear::ObservationGraph& graph,
                    const optim::State& state,
                    double limit,
                    int p) {
  const auto ray = [&](int k) -> Eigen::Vector3d {
    const double* pose =
        state.cameras.data() + problem.camera_offset(graph.camera[graph.of_point[k]]);
    const Eigen::Map<const Eigen::Vector3d> point(state.points.data() + problem.point_offset(p));
    return point - Eigen::Vector3d(pose[3], pose[7], pose[11]);
  };
  const int begin = graph.point_begin[p], end = graph.point_begin[p + 1];
  const int first = graph.of_point[begin];
  const double focal = state.intrinsics[problem.intrinsics_offset(graph.camera[first])];
  if (!(focal > 0.0)) return false;  // tells of no angle
  const double inverse_sigma =
      residuals::whitener_of(problem.sigma_px, problem.covariance_px2, graph.source[first])
          .inverse_sigma;
  const double angle = limit / (inverse_sigma * focal);
  const Eigen::Vector3d reference = ray(begin);
  for (int k = begin + 1; k < end; ++k) {
    if (!(squared_sine(reference, ray(k)) <= angle * angle)) return false;
  }
  return true;
}

// Of models that are compiled; what a function calls so is its own affair.
std::optional<int> index_of_intrinsic(const CameraModel& model, std::string_view name) {
  if (model.function() != nullptr) return std::nullopt;
  const auto names = intrinsic_names(model);
  const auto found = std::ranges::find(names, name);
  if (found == names.end()) return std::nullopt;
  return static_cast<int>(found - names.begin());
}

// Which rows of intrinsics cameras with observations have.
std::vector<char> rows_in_use(const Problem& problem, const linear::ObservationGraph& graph) {
  std::vector<char> used(static_cast<std::size_t>(problem.num_groups()));
  for (int i = 0; i < problem.num_cameras(); ++i)
    used[problem.intrinsics_index[i]] |= static_cast<char>(graph.is_observed(i));
  return used;
}

bool is_of_images_alone(std::span<const char> of_others, int p) {
  return of_others.empty() || of_others[p] == 0;
}

}  // namespace

std::vector<std::string> warnings_about(const linear::ObservationGraph& graph,
                                        const Rigs& rigs,
                                        const Anchors& anchors,
                                        Exchange& exchange) {
  std::vector<std::string> warnings;
  const auto has_views = [&](int p, int count) {
    return is_of_images_alone(anchors.of_others, p) && graph.observations_of_point(p) == count;
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
      [&](int p) {
        return has_views(p, 1) && (anchors.fixed_points.empty() || anchors.fixed_points[p] == 0);
      },
      "seen by one camera only, the depth is held by damping alone",
      warnings);
  const std::vector<Part> parts =
      fixed_in_parts(graph, parts_of(graph, rigs, exchange), anchors, exchange);
  if (parts.size() > 1) {
    warnings.push_back("the cameras fall into " + std::to_string(parts.size()) +
                       " parts that share no point: " + relation_of(parts, anchors));
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
      [&](int p) {
        return is_of_images_alone(of_others, p) && !problem.is_fixed_point(p) &&
               lacks_baseline(problem, graph, p);
      },
      "seen from one place, the depth is held by damping alone",
      warnings);
  return warnings;
}

std::vector<std::string> warnings_about_parallax(const Problem& problem,
                                                 const linear::ObservationGraph& graph,
                                                 const optim::State& state,
                                                 double rms,
                                                 Exchange& exchange,
                                                 std::span<const char> of_others) {
  if (!is_metric(problem.camera_model) || problem.camera_model.function() != nullptr) return {};
  // Errors that are found to be smaller than declared count as found: with pixels over the focal
  // length, and the default of one pixel, all is noise. The fit takes up part of them.
  constexpr double kDeclared = 3, kFound = 6, kMost = 0.5;
  const double limit = std::min(kDeclared, kFound * rms);
  // So many tell what most are, and cost nothing beside a step.
  constexpr int kSample = 1024;
  const int stride = std::max(1, graph.num_points / kSample);
  long seen = 0, flat = 0;
  for (int p = 0; p < graph.num_points; p += stride) {
    if (graph.observations_of_point(p) < 2 || problem.is_fixed_point(p) ||
        !is_of_images_alone(of_others, p))
      continue;
    ++seen;
    flat += static_cast<long>(lacks_parallax(problem, graph, state, limit, p));
  }
  seen = std::lround(exchange.sum(static_cast<double>(seen)));
  flat = std::lround(exchange.sum(static_cast<double>(flat)));
  if (!(static_cast<double>(flat) > kMost * static_cast<double>(seen))) return {};
  return {std::to_string(flat) + " of " + std::to_string(seen) +
          " points looked at that several cameras see have a parallax within the noise: the images "
          "do not tell their depths, nor how far apart the cameras are; a rotation explains them "
          "as well"};
}

std::vector<std::string> warnings_about_cameras(const Problem& problem,
                                                const linear::ObservationGraph& graph,
                                                bool constrained) {
  std::vector<std::string> warnings;
  if (!is_metric(problem.camera_model)) return warnings;
  constexpr double kPoseNeeds = 3;  // observations: two numbers each for six
  if (!constrained && problem.rigs.frame_of_camera.empty()) {
    warn(
        "camera",
        graph.num_cameras,
        [&](int i) {
          return graph.is_observed(i) && !problem.is_fixed_camera(i) &&
                 graph.of_camera_on_all_ranks[i] < kPoseNeeds;
        },
        "fewer than 3 observations, the pose is held by damping alone",
        warnings);
  }
  const std::vector<char> used = rows_in_use(problem, graph);
  const auto warn_of_rows = [&](const char* name, const auto& applies, const char* text) {
    const std::optional<int> k = index_of_intrinsic(problem.camera_model, name);
    const auto is_so = [&](int g) {
      return used[g] && applies(problem.intrinsics[problem.row_offset(g) + *k]);
    };
    if (k) warn("intrinsics row", problem.num_groups(), is_so, text, warnings);
  };
  warn_of_rows(
      "f",
      [](double f) { return !(f > 0.0); },
      "the focal length f is not positive: a lens has f > 0, images upside down have negative y");
  warn_of_rows(
      "aspect",
      [](double aspect) { return aspect > kLeastFy; },
      "the aspect, fy / fx, is more than 20: is it fy?");
  return warnings;
}

}  // namespace sfmcpp::ba

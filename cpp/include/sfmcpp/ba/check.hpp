// Checks of a problem: rules that it must not break, and warnings about what is legal but doubtful.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/linear/observation_graph.hpp"
#include "sfmcpp/linear/parameter_map.hpp"

namespace sfmcpp::ba {

// Throws InvalidArgument naming array, position, value and rule: sizes that do not match, indices
// out of range, numbers that are not finite, matrices that are no rotations, σ that are not
// positive, Σ that are no covariances.
void check_arrays(const Problem& problem);
// Its three parts, in this order; the second and the third need the first, and not each other.
void check_sizes(const Problem& problem);
void check_indices(const Problem& problem);
void check_values(const Problem& problem);

// Throws InvalidArgument if a camera observes a point twice.
void check_duplicates(const Problem& problem, const linear::ObservationGraph& graph);

// Degrees of freedom of the whole world that no residual determines: images determine neither its
// place nor its size. `state`: where it is examined which motions leave constraints as they are.
long num_world_freedoms(const Problem& problem,
                        const linear::ObservationGraph& graph,
                        const optim::State& state,
                        Exchange& exchange = this_process());

// Throws InvalidArgument if there are fewer residuals than unknowns, those of constraints included.
// `world_freedoms` of the unknowns are asked for only where it matters, by all ranks or none.
void check_determined(
    const linear::ObservationGraph& graph,
    const linear::ParameterMap& map,
    long constraint_equations = 0,
    Exchange& exchange = this_process(),
    const std::function<long()>& world_freedoms = [] { return 0L; });

// What besides images holds points, cameras and parts of a problem.
struct Anchors {
  bool constrained = false;                      // whether there are constraints
  std::span<const char> of_others{};             // P: whether other residuals are on a point
  std::span<const std::uint8_t> fixed_points{};  // P, as in the problem; empty: none
  std::span<const std::uint8_t> fixed_cameras{};
  bool is_metric = true;
};
inline Anchors anchors_of(const Problem& problem) {
  return {.fixed_points = problem.fixed_points,
          .fixed_cameras = problem.fixed_cameras,
          .is_metric = is_metric(problem.camera_model)};
}

// Legal but worth saying, by name: cameras and points without observations, points seen once, parts
// of the problem that share no point, and what can hold them together. Of points, each rank speaks
// of its own.
std::vector<std::string> warnings_about(const linear::ObservationGraph& graph,
                                        const Rigs& rigs = {},
                                        const Anchors& anchors = {},
                                        Exchange& exchange = this_process());

// The same of points that may move and that all their cameras see from one place.
std::vector<std::string> warnings_about_baselines(const Problem& problem,
                                                  const linear::ObservationGraph& graph,
                                                  std::span<const char> of_others = {});

// Whether at a state most points of all ranks have a parallax below the noise, of which `rms` tells
// in standard deviations: an image set of one place has such points wherever it ends.
std::vector<std::string> warnings_about_parallax(const Problem& problem,
                                                 const linear::ObservationGraph& graph,
                                                 const optim::State& state,
                                                 double rms,
                                                 Exchange& exchange = this_process(),
                                                 std::span<const char> of_others = {});

// No lens squeezes images so much: an aspect above this is probably a focal length, fy [px].
inline constexpr double kLeastFy = 20.0;

// The same of cameras whose observations are fewer than the six numbers of their pose, and of rows
// of intrinsics whose focal length is not positive, or whose aspect looks like one.
std::vector<std::string> warnings_about_cameras(const Problem& problem,
                                                const linear::ObservationGraph& graph,
                                                bool constrained = false);

}  // namespace sfmcpp::ba

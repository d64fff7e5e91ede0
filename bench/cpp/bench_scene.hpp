// The scene that the benchmarks share, and the objects of a solve, step by step.
#pragma once

#include "sfmcpp/ba/bundle_model.hpp"
#include "sfmcpp/ba/mask.hpp"
#include "support/small_scenes.hpp"

namespace sfmcpp::bench {

// Of the shape of BAL's problem-49-7776: 50 cameras, about 32,000 observations.
inline support::OwnedProblem make_scene(CameraModelId model = CameraModelId::kBal,
                                        int cameras = 50,
                                        int points = 8000,
                                        int window = 4) {
  support::SceneOptions options = support::perturbed(model);
  options.num_cameras = cameras;
  options.num_points = points;
  options.window = window;
  return support::make_circle_scene(options);
}

struct Bench {
  explicit Bench(const support::OwnedProblem& scene, int threads = 1)
      : problem(scene.view()),
        graph(linear::make_observation_graph(problem.num_cameras(),
                                             problem.num_points(),
                                             problem.camera_index,
                                             problem.point_index)),
        intrinsics(ba::free_intrinsics(problem, graph)),
        map(ba::make_parameter_map(problem, graph, intrinsics, false)),
        pool(threads),
        model(problem, graph, map, intrinsics, pool),
        state(ba::state_of(problem)) {}

  ba::Problem problem;
  linear::ObservationGraph graph;
  std::vector<int> intrinsics;
  linear::ParameterMap map;
  ThreadPool pool;
  ba::BundleModel model;
  optim::State state;
};

}  // namespace sfmcpp::bench

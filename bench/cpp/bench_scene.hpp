// The scene that the benchmarks share.
#pragma once

#include "support/linearized_problem.hpp"

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

}  // namespace sfmcpp::bench

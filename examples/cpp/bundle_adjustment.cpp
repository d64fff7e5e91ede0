// Three cameras in a row look at twenty points, which start 5 cm off, as does the last camera,
// whose position a receiver knows: a robust loss, a constraint, the history as it happens, and how
// certain a point is. Build: see CMakeLists.txt beside this file.
#include <cmath>
#include <cstdint>
#include <iostream>
#include <random>
#include <vector>

#include <sfmcpp/ba/linear_model.hpp>
#include <sfmcpp/ba/solve.hpp>
#include <sfmcpp/residuals/constraint_set.hpp>

int main() {
  std::vector<double> cameras{1, 0, 0, -1, 0, 1, 0, 0, 0, 0, 1, 0,  // [R | c], row by row
                              1, 0, 0, 0,  0, 1, 0, 0, 0, 0, 1, 0,
                              1, 0, 0, 1,  0, 1, 0, 0, 0, 0, 1, 0};
  const std::vector<double> intrinsics{500, 1, 320, 240, 0};  // f [px], aspect, cx, cy, skew
  const std::vector<int> intrinsics_index{0, 0, 0};           // all cameras share that row
  std::vector<double> points, pixels;
  std::vector<int> camera_index, point_index;
  std::mt19937 random(0);
  std::uniform_real_distribution<double> side(-1.0, 1.0);
  for (int p = 0; p < 20; ++p) {
    const double x = side(random), y = side(random), z = 6.0 + side(random);
    points.insert(points.end(), {x + 0.05, y, z});
    for (int i = 0; i < 3; ++i) {
      camera_index.push_back(i);
      point_index.push_back(p);
      pixels.insert(pixels.end(), {320 + 500 * (x - cameras[12 * i + 3]) / z, 240 + 500 * y / z});
    }
  }
  cameras[27] += 0.05;
  const std::vector<std::uint8_t> fixed_cameras{1, 0, 0}, fixed_intrinsics(5, 1);

  // The weight of a measurement of three numbers with σ = 2 cm: 3/σ².
  sfmcpp::residuals::ConstraintMember receiver;
  receiver.camera = 2;
  receiver.pose.translation = {1.0, 0.0, 0.0};
  sfmcpp::residuals::ConstraintSet constraints;
  constraints.add({.name = "gps",
                   .kind = sfmcpp::residuals::ConstraintKind::kPosition,
                   .weight = 3 / (0.02 * 0.02),
                   .members = {receiver}});

  const sfmcpp::ba::Problem problem{.camera_model = sfmcpp::CameraModelId::kCalibrated,
                                    .cameras = cameras,
                                    .intrinsics = intrinsics,
                                    .points = points,
                                    .intrinsics_index = intrinsics_index,
                                    .camera_index = camera_index,
                                    .point_index = point_index,
                                    .pixels = pixels,
                                    .fixed_cameras = fixed_cameras,
                                    .fixed_intrinsics = fixed_intrinsics,
                                    .constraints = &constraints};
  sfmcpp::ba::SolveOptions options;
  options.loss = sfmcpp::LossKind::kHuber;
  options.loss_scale_px = 1.0;
  sfmcpp::optim::Events events;
  events.on_iteration = [](const sfmcpp::optim::Iteration& iteration) {
    std::cout << "iteration " << iteration.number << ": cost " << iteration.cost << "\n";
    return sfmcpp::optim::Signal::kContinue;
  };
  sfmcpp::optim::State state = sfmcpp::ba::state_of(problem);
  const sfmcpp::ba::SolveSummary summary = sfmcpp::ba::solve(problem, options, events, state);
  std::cout << "RMS " << summary.initial_rms_px << " px -> " << summary.final_rms_px << " px\n";

  sfmcpp::ba::LinearModel model(problem, options, state);  // without `state`: at the start
  std::vector<int> first(20);
  model.point_columns(first.data());
  const std::vector<int> columns{first[0], first[0] + 1, first[0] + 2};
  const double variance = model.covariance(columns)(2, 2);
  std::cout << "depth of point 0: " << state.points[2] << " +- " << std::sqrt(variance) << "\n";
  return summary.final_rms_px < 1e-6 && variance > 0.0 ? 0 : 1;
}

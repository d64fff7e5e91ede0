// Residuals, a loss and events of your own: three cameras whose heights a barometer knows, Tukey's
// loss as a table, and a solve that is stopped and resumed.
#include <algorithm>
#include <csignal>
#include <iostream>
#include <memory>
#include <random>
#include <vector>

#include <sfmcpp/ba/check_jacobians.hpp>
#include <sfmcpp/ba/solve.hpp>
#include <sfmcpp/residuals/constraint_set.hpp>

namespace {

// The third coordinate of each centre, measured to 1 cm.
class Barometer final : public sfmcpp::residuals::ResidualFunction {
 public:
  explicit Barometer(std::vector<double> heights) : heights_(std::move(heights)) {}
  int rows() const override { return 1; }
  void evaluate(const double* poses, const double*, const Output& out) const override {
    constexpr double kSigma = 0.01;
    for (std::size_t k = 0; k < heights_.size(); ++k) {
      out.residuals[k] = (poses[12 * k + 11] - heights_[k]) / kSigma;
      if (out.by_poses == nullptr) continue;
      double* by_pose = out.by_poses + 6 * k;  // rotation x, y, z, then centre x, y, z
      std::fill_n(by_pose, 5, 0.0);
      by_pose[5] = 1 / kSigma;
    }
  }

 private:
  std::vector<double> heights_;
};

volatile std::sig_atomic_t interrupted = 0;

}  // namespace

int main() {
  std::vector<double> cameras{1, 0, 0, -1, 0, 1, 0, 0, 0, 0, 1, 0.0,  // [R | c], row by row
                              1, 0, 0, 0,  0, 1, 0, 0, 0, 0, 1, 0.5,
                              1, 0, 0, 1,  0, 1, 0, 0, 0, 0, 1, -0.5};
  const std::vector<double> intrinsics{500, 1, 320, 240, 0};
  const std::vector<int> intrinsics_index{0, 0, 0};
  std::vector<double> points, pixels;
  std::vector<int> camera_index, point_index;
  std::mt19937 random(0);
  std::uniform_real_distribution<double> side(-1.0, 1.0);
  for (int p = 0; p < 20; ++p) {
    const double x = side(random), y = side(random), z = 6.0 + side(random);
    points.insert(points.end(), {x + 0.05, y, z});
    for (int i = 0; i < 3; ++i) {
      const double depth = z - cameras[12 * i + 11];
      camera_index.push_back(i);
      point_index.push_back(p);
      pixels.insert(pixels.end(),
                    {320 + 500 * (x - cameras[12 * i + 3]) / depth, 240 + 500 * y / depth});
    }
  }
  cameras[27] += 0.05;
  const std::vector<std::uint8_t> fixed_cameras{1, 0, 0}, fixed_intrinsics(5, 1);

  // By itself: made within the group, GCC 12 warns of a field that is not initialised.
  const auto barometer = std::make_shared<Barometer>(std::vector{0.0, 0.5, -0.5});
  const sfmcpp::residuals::ConstraintGroup heights{
      .name = "barometer",
      .members = {{.camera = 0}, {.camera = 1}, {.camera = 2}},
      .function = barometer};
  sfmcpp::residuals::ConstraintSet constraints;
  constraints.add(heights);
  const sfmcpp::ba::Problem problem{.cameras = cameras,
                                    .intrinsics = intrinsics,
                                    .points = points,
                                    .intrinsics_index = intrinsics_index,
                                    .camera_index = camera_index,
                                    .point_index = point_index,
                                    .pixels = pixels,
                                    .fixed_cameras = fixed_cameras,
                                    .fixed_intrinsics = fixed_intrinsics,
                                    .constraints = &constraints};
  std::cout << "derivatives off by " << sfmcpp::ba::derivative_error(problem, heights) << "\n";

  sfmcpp::ba::SolveOptions options;
  // The weight of s = ‖r‖² / scale² is (1 − s)² up to 1, and 0 beyond the last knot.
  options.loss_table = std::make_shared<sfmcpp::LossTable>(
      "tukey", std::vector{0.0, 1.0}, std::vector{1.0, -2.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0});
  options.loss_scale_px = 50.0;

  using sfmcpp::optim::Signal;
  sfmcpp::optim::Events events;
  std::signal(SIGINT, [](int) { interrupted = 1; });
  events.poll = [] { return interrupted ? Signal::kInterrupt : Signal::kContinue; };
  events.on_iteration = [](const sfmcpp::optim::Iteration& iteration) {
    return iteration.number == 2 ? Signal::kStop : Signal::kContinue;
  };
  sfmcpp::optim::Resumption kept;  // to be written to a file, say
  events.on_resumable = [&](const auto& where, bool last) {
    if (last) kept = where();
  };
  sfmcpp::optim::State state = sfmcpp::ba::state_of(problem);
  std::cout << sfmcpp::ba::solve(problem, options, events, state).minimizer.message << "\n";

  // The same start and options: the bits are those of a solve that was never stopped.
  events.on_iteration = [](const sfmcpp::optim::Iteration&) { return Signal::kContinue; };
  state = sfmcpp::ba::state_of(problem);
  const sfmcpp::ba::SolveSummary summary =
      sfmcpp::ba::solve(problem, options, events, state, sfmcpp::this_process(), &kept);
  std::cout << summary.minimizer.message << ", RMS " << summary.final_rms_px << " px\n";
  return summary.final_rms_px < 1e-6 ? 0 : 1;
}

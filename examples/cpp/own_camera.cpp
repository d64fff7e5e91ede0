// A camera model of your own, without a new build of the library: an equidistant fisheye lens,
// u = f θ x / r + cx with r = √(x² + y²) and θ the angle from the axis, with its derivatives.
#include <array>
#include <cmath>
#include <iostream>
#include <random>
#include <string>
#include <vector>

#include <sfmcpp/ba/check_jacobians.hpp>
#include <sfmcpp/ba/solve.hpp>
#include <sfmcpp/cameras/camera_function.hpp>

namespace {

class Equidistant final : public sfmcpp::CameraFunction {
 public:
  const std::string& name() const override { return name_; }
  std::span<const std::string_view> intrinsic_names() const override { return kNames; }

  // All points in one call, each with its own copy of the three intrinsics.
  void image(int count,
             const double* points,
             const double* intrinsics,
             double* pixels,
             const Jacobians* jacobians) const override {
    for (int k = 0; k < count; ++k) {
      const double x = points[3 * k], y = points[3 * k + 1], z = points[3 * k + 2];
      const auto [f, cx, cy] =
          std::array{intrinsics[3 * k], intrinsics[3 * k + 1], intrinsics[3 * k + 2]};
      const double r = std::hypot(x, y), s = r * r + z * z;
      const bool on_axis = r < 1e-9 * z;
      const double g = on_axis ? 1 / z : std::atan2(r, z) / r;    // θ / r
      const double by_r = on_axis ? 0.0 : (z / s - g) / (r * r);  // ∂g/∂r / r
      pixels[2 * k] = f * g * x + cx;
      pixels[2 * k + 1] = f * g * y + cy;
      if (jacobians == nullptr) continue;
      double* p = jacobians->by_point + 6 * k;  // two rows of x, y, z; ∂g/∂z = −1 / s
      p[0] = f * (g + x * x * by_r), p[1] = f * x * y * by_r, p[2] = -f * x / s;
      p[3] = f * x * y * by_r, p[4] = f * (g + y * y * by_r), p[5] = -f * y / s;
      double* q =
          jacobians->by_intrinsics + 6 * k;  // two rows of f, cx, cy: zeros are written, too
      q[0] = g * x, q[1] = 1, q[2] = 0;
      q[3] = g * y, q[4] = 0, q[5] = 1;
    }
  }

 private:
  static constexpr std::array<std::string_view, 3> kNames{"f", "cx", "cy"};
  std::string name_ = "equidistant";
};

}  // namespace

int main() {
  const Equidistant lens;  // outlives the problem
  std::vector<double> intrinsics{300, 320, 240}, cameras, points, pixels;
  std::vector<int> intrinsics_index, camera_index, point_index;
  for (double x : {-1.0, 0.0, 1.0}) {
    cameras.insert(cameras.end(), {1, 0, 0, x, 0, 1, 0, 0, 0, 0, 1, x * x});  // [R | c]
    intrinsics_index.push_back(0);
  }
  std::mt19937 random(0);
  std::uniform_real_distribution<double> side(-3.0, 3.0);
  for (int p = 0; p < 60; ++p) {
    const std::array<double, 3> point{side(random), side(random), 4.0 + side(random) / 3};
    for (int i = 0; i < 3; ++i) {
      std::array<double, 3> seen{point};
      for (int axis = 0; axis < 3; ++axis) seen[axis] -= cameras[12 * i + 4 * axis + 3];
      pixels.resize(pixels.size() + 2);
      lens.image(1, seen.data(), intrinsics.data(), &pixels[pixels.size() - 2], nullptr);
      camera_index.push_back(i);
      point_index.push_back(p);
    }
    points.insert(points.end(), {point[0] + 0.05, point[1], point[2] - 0.05});
  }
  intrinsics[0] = 310;
  const sfmcpp::ba::Problem problem{.camera_model = sfmcpp::CameraModel(lens),
                                    .cameras = cameras,
                                    .intrinsics = intrinsics,
                                    .points = points,
                                    .intrinsics_index = intrinsics_index,
                                    .camera_index = camera_index,
                                    .point_index = point_index,
                                    .pixels = pixels};
  const sfmcpp::ba::JacobianCheck check = sfmcpp::ba::check_jacobians(problem);
  std::cout << "derivatives off by " << check.worst_error << "\n";
  sfmcpp::optim::State state = sfmcpp::ba::state_of(problem);
  const sfmcpp::ba::SolveSummary summary = sfmcpp::ba::solve(problem, {}, {}, state);
  std::cout << sfmcpp::enum_name(summary.minimizer.termination) << ", RMS " << summary.final_rms_px
            << " px, f = " << state.intrinsics[0] << "\n";
  return check.worst_error < 1e-6 && summary.final_rms_px < 1e-4 ? 0 : 1;
}

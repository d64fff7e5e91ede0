#include "support/small_scenes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>
#include <span>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include "sfmcpp/math/so3.hpp"
#include "support/camera_dispatch.hpp"
#include "support/random_views.hpp"
#include "support/uncalibrated.hpp"

namespace sfmcpp::support {
namespace {

constexpr double kRadius = 10.0;
constexpr double kHalfCube = 3.0;
constexpr std::array<double, 3> kSigmas{0.5, 1.0, 2.0};
constexpr std::array<std::array<double, 4>, 3> kCovariances{
    {{4.0, 1.8, 1.8, 1.0}, {0.25, 0.0, 0.0, 0.25}, {0.3, -0.5, -0.5, 2.5}}};

std::vector<double> true_intrinsics(CameraModelId model) {
  switch (model) {
    case CameraModelId::kPerspective:
      return {800, 1.02, 320, 240, 0.5, -0.12, 0.05, 0.01, -0.004, 0.002, 1e-3, -5e-4};
    case CameraModelId::kBal:
      return {800, -0.12, 0.05};
    case CameraModelId::kPlugin:
      return strong_intrinsics(model);
    case CameraModelId::kCalibrated:
    case CameraModelId::kProjective:
      break;
  }
  return {800, 1.02, 320, 240, 0.5};
}

std::vector<int> free_by_default(CameraModelId model) {
  if (model == CameraModelId::kBal) return {0, 1, 2};
  if (model == CameraModelId::kPerspective || model == CameraModelId::kPlugin) return {0};
  return {};
}

// Of a metric camera model.
class CircleScene {
 public:
  CircleScene(const SceneOptions& options, CameraModelId model)
      : options_(options), model_(model), random_(options.seed) {
    scene_.camera_model = model;
  }

  OwnedProblem make() {
    place_points();
    for (int i = 0; i < options_.num_cameras; ++i) place_camera(i);
    set_intrinsics();
    scene_.fixed_cameras.assign(options_.num_cameras, 0);
    scene_.fixed_points.assign(options_.num_points, 0);
    scene_.truth = ba::state_of(scene_.view());
    for (int p = 0; p < options_.num_points; ++p) observe_point(p);
    perturb();
    return std::move(scene_);
  }

 private:
  double normal() { return normal_(random_); }

  void place_points() {
    std::uniform_real_distribution<double> side(-kHalfCube, kHalfCube);
    for (int k = 0; k < 3 * options_.num_points; ++k) scene_.points.push_back(side(random_));
  }

  // Looks at the origin, y down the world's z axis, and is turned a little about its axis.
  void place_camera(int i) {
    const double angle = 2.0 * std::numbers::pi * i / options_.num_cameras;
    const Eigen::Vector3d centre(
        kRadius * std::cos(angle), kRadius * std::sin(angle), std::sin(3.0 * angle));
    Eigen::Matrix3d r;
    r.col(2) = -centre.normalized();
    r.col(0) = r.col(2).cross(Eigen::Vector3d::UnitZ()).normalized();
    r.col(1) = r.col(2).cross(r.col(0));
    r = r * exp_so3(Eigen::Vector3d(0, 0, 0.3 * normal()));
    for (int row = 0; row < 3; ++row) {
      for (int k = 0; k < 3; ++k) scene_.cameras.push_back(r(row, k));
      scene_.cameras.push_back(centre[row]);
    }
  }

  void set_intrinsics() {
    const int groups = options_.num_groups > 0 ? options_.num_groups : options_.num_cameras;
    const std::vector<double> row = true_intrinsics(model_);
    std::vector<std::uint8_t> fixed(row.size(), 1);
    for (int k : options_.free_intrinsics.value_or(free_by_default(model_))) fixed[k] = 0;
    for (int g = 0; g < groups; ++g) {
      const std::size_t first = scene_.intrinsics.size();
      scene_.intrinsics.insert(scene_.intrinsics.end(), row.begin(), row.end());
      scene_.intrinsics[first] *= 1.0 + 0.01 * g;
      scene_.fixed_intrinsics.insert(scene_.fixed_intrinsics.end(), fixed.begin(), fixed.end());
    }
    for (int i = 0; i < options_.num_cameras; ++i) scene_.intrinsics_index.push_back(i % groups);
  }

  void observe_point(int p) {
    const bool all = options_.window <= 0 || options_.window >= options_.num_cameras;
    const int first =
        static_cast<int>(static_cast<long>(p) * options_.num_cameras / options_.num_points);
    for (int k = 0; k < (all ? options_.num_cameras : options_.window); ++k) {
      observe((all ? k : first + k) % options_.num_cameras, p);
    }
  }

  void observe(int camera, int p) {
    const int row = scene_.intrinsics_index[camera] * scene_.view().num_intrinsics();
    const ImagePoint<double> image = project(model_,
                                             scene_.cameras.data() + kCameraStorage * camera,
                                             scene_.intrinsics.data() + row,
                                             scene_.points.data() + 3L * p);
    double noise = options_.noise_px;
    if (options_.varied_sigma) {
      scene_.sigma_px.push_back(kSigmas[scene_.sigma_px.size() % kSigmas.size()]);
      noise *= scene_.sigma_px.back();
    }
    const double du = noise * normal(), dv = noise * normal();
    if (!options_.covariances) return scene_.observe(camera, p, image.u + du, image.v + dv);
    const auto& sigma = kCovariances[scene_.camera_index.size() % kCovariances.size()];
    scene_.covariance_px2.insert(scene_.covariance_px2.end(), sigma.begin(), sigma.end());
    const Eigen::Vector2d off =
        Eigen::Matrix2d(sigma.data()).llt().matrixL() * Eigen::Vector2d(du, dv);
    scene_.observe(camera, p, image.u + off.x(), image.v + off.y());
  }

  void perturb() {
    for (int i = 0; i < options_.num_cameras; ++i) {
      std::array<double, kPoseTangent> delta;
      for (int k = 0; k < kPoseTangent; ++k) {
        delta[k] = normal() * (k < 3 ? options_.rotation_error_rad : options_.centre_error_m);
      }
      double* camera = scene_.cameras.data() + kCameraStorage * i;
      if (options_.rotation_error_rad + options_.centre_error_m > 0) {
        plus_pose(camera, delta.data(), camera);
      }
    }
    for (double& x : scene_.points) x += options_.point_error_m * normal();
    for (std::size_t k = 0; k < scene_.intrinsics.size(); ++k) {
      const double error = options_.intrinsics_error * normal();
      if (!scene_.fixed_intrinsics[k]) scene_.intrinsics[k] *= 1.0 + error;
    }
  }

  const SceneOptions& options_;
  CameraModelId model_;
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
  OwnedProblem scene_;
};

optim::State uncalibrated(const OwnedProblem& scene, const optim::State& state) {
  optim::State result;
  for (std::size_t i = 0; i < scene.intrinsics_index.size(); ++i) {
    const std::span<const double> row(&state.intrinsics[5UL * scene.intrinsics_index[i]], 5);
    const auto camera =
        uncalibrated_camera(&state.cameras[12 * i], calibration_matrix(row), kImageFrame);
    result.cameras.insert(result.cameras.end(), camera.begin(), camera.end());
  }
  for (std::size_t k = 0; k < state.points.size(); k += 3) {
    const Eigen::Vector4d q = homogeneous_point(&state.points[k]);
    result.points.insert(result.points.end(), q.begin(), q.end());
  }
  for (std::size_t k = 0; k < state.intrinsics.size(); k += 5)
    result.intrinsics.insert(result.intrinsics.end(), kImageFrame.begin(), kImageFrame.end());
  return result;
}

// The same images of the same scene, by cameras that know nothing of their calibration.
OwnedProblem uncalibrated(const OwnedProblem& calibrated) {
  OwnedProblem scene = calibrated;
  scene.camera_model = CameraModelId::kProjective;
  scene.truth = uncalibrated(calibrated, calibrated.truth);
  scene.start_from(uncalibrated(calibrated, ba::state_of(calibrated.view())));
  scene.fixed_intrinsics.assign(scene.intrinsics.size(), 1);
  return scene;
}

}  // namespace

ba::Problem OwnedProblem::view() const {
  return {.camera_model = camera_model,
          .cameras = cameras,
          .intrinsics = intrinsics,
          .points = points,
          .intrinsics_index = intrinsics_index,
          .camera_index = camera_index,
          .point_index = point_index,
          .pixels = pixels,
          .sigma_px = sigma_px,
          .covariance_px2 = covariance_px2,
          .fixed_cameras = fixed_cameras,
          .fixed_points = fixed_points,
          .fixed_intrinsics = fixed_intrinsics,
          .constraints = &constraints};
}

void OwnedProblem::start_from(const optim::State& state) {
  cameras = state.cameras;
  intrinsics = state.intrinsics;
  points = state.points;
}

void OwnedProblem::observe(int camera, int point, double u, double v) {
  camera_index.push_back(camera);
  point_index.push_back(point);
  pixels.push_back(u);
  pixels.push_back(v);
}

OwnedProblem make_circle_scene(const SceneOptions& options) {
  if (is_metric(options.camera_model)) return CircleScene(options, options.camera_model).make();
  return uncalibrated(CircleScene(options, CameraModelId::kCalibrated).make());
}

std::vector<bool> spoil(OwnedProblem& problem, double share, unsigned seed) {
  std::mt19937 random(seed);
  std::bernoulli_distribution is_wrong(share);
  std::array<std::uniform_real_distribution<double>, 2> place;
  for (std::size_t i : {0, 1}) {
    double low = problem.pixels[i], high = low;
    for (std::size_t k = i; k < problem.pixels.size(); k += 2) {
      low = std::min(low, problem.pixels[k]);
      high = std::max(high, problem.pixels[k]);
    }
    place[i] = std::uniform_real_distribution<double>(low, high);
  }
  std::vector<bool> wrong(problem.pixels.size() / 2);
  for (std::size_t k = 0; k < wrong.size(); ++k) {
    wrong[k] = is_wrong(random);
    for (std::size_t i = 0; wrong[k] && i < 2; ++i) problem.pixels[2 * k + i] = place[i](random);
  }
  return wrong;
}

SceneOptions perturbed(CameraModelId model) {
  SceneOptions options;
  options.camera_model = model;
  options.noise_px = 0.5;
  options.rotation_error_rad = 0.01;
  options.centre_error_m = 0.1;
  options.point_error_m = 0.1;
  options.intrinsics_error = 0.02;
  return options;
}

}  // namespace sfmcpp::support

// The second derivative along a step, of every camera model and instruction set, against numeric
// second differences of the projection of retracted cameras and points.
#include <cmath>
#include <random>

#include <Eigen/Core>
#include <gtest/gtest.h>

#include "sfmcpp/residuals/reprojection.hpp"
#include "support/kernel_cases.hpp"
#include "support/random_batch.hpp"

namespace sfmcpp::bending_kernels_test {
namespace {

using Eigen::Vector2d;
using support::RandomBatch;

class BendingKernelCase : public testing::TestWithParam<support::KernelCase> {
 protected:
  static constexpr int kCount = 19;

  BendingKernelCase() {
    std::mt19937 random(5);
    std::normal_distribution<double> normal;
    const double size = is_metric(GetParam().model) ? 0.1 : 0.01;
    for (double& x : camera_step) x = size * normal(random);
    // Projective cameras go straight.
    for (int i = 0; i < 3 && is_metric(GetParam().model); ++i) camera_bend[i] = normal(random);
    for (double& x : point_steps) x = size * normal(random);
    // Of the parameters that can be free; the frame of a projective image cannot.
    if (has_free_intrinsics(GetParam().model)) {
      for (std::size_t k = 0; k < batch.intrinsics.size(); ++k)
        intrinsics_step[k] = 0.05 * normal(random) * (1.0 + std::abs(batch.intrinsics[k]));
    }
  }

  Vector2d pixel(int k, double length) const {
    std::array<double, kMaxCameraTangent> delta;
    for (int i = 0; i < kMaxCameraTangent; ++i) delta[i] = length * camera_step[i];
    for (int i = 0; i < 3; ++i) delta[i] += 0.5 * length * length * camera_bend[i];
    std::array<double, kCameraStorage> camera;
    plus_camera(batch.model, batch.camera.data(), delta.data(), camera.data());
    std::vector<double> intrinsics = batch.intrinsics;
    for (std::size_t i = 0; i < intrinsics.size(); ++i)
      intrinsics[i] += length * intrinsics_step[i];
    double move[3], point[kMaxPointStorage];
    for (int i = 0; i < 3; ++i) move[i] = length * point_steps[3 * batch.point[k] + i];
    plus_point(batch.model, batch.stored_point(k), move, point);
    const auto image = support::project(batch.model, camera.data(), intrinsics.data(), point);
    return {image.u, image.v};
  }
  Vector2d second_difference(int k, double h) const {
    return (pixel(k, h) - 2.0 * pixel(k, 0.0) + pixel(k, -h)) / (h * h);
  }

  RandomBatch batch{GetParam().model, kCount};
  std::array<double, kMaxCameraTangent> camera_step{};
  std::array<double, 6> camera_bend{};  // of the turn alone
  std::array<double, 12> intrinsics_step{};
  std::vector<double> point_steps = std::vector<double>(3 * (kCount + 3));
};

TEST_P(BendingKernelCase, IsTheWeightedSecondDifferenceOfTheProjection) {
  std::vector<double> u(kCount + kReadAhead), v(kCount + kReadAhead);
  GetParam()
      .isa.bending(GetParam().model)
      .bend({.observations = batch.view(),
             .camera_step = camera_step.data(),
             .camera_bend = camera_bend.data(),
             .intrinsics_step = intrinsics_step.data(),
             .point_steps = point_steps.data()},
            u.data(),
            v.data());
  for (int k = 0; k < kCount; ++k) {
    // Richardson's extrapolation: an error of the fourth order in the length.
    const double h = 4e-3;
    const Vector2d numeric = (4.0 * second_difference(k, h) - second_difference(k, 2.0 * h)) / 3.0 *
                             batch.inverse_sigma[k];
    const double tolerance = 1e-5 * (batch.inverse_sigma[k] + numeric.norm());
    EXPECT_GT(numeric.norm(), 1e-3);
    EXPECT_NEAR(u[k], numeric[0], tolerance) << "observation " << k;
    EXPECT_NEAR(v[k], numeric[1], tolerance) << "observation " << k;
  }
}

INSTANTIATE_TEST_SUITE_P(All,
                         BendingKernelCase,
                         testing::ValuesIn(support::all_kernel_cases()),
                         &support::name_of_kernel_case);

}  // namespace
}  // namespace sfmcpp::bending_kernels_test

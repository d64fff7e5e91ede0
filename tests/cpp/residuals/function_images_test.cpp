// Images by a function against the kernels of the compiled model of the same lens.
#include <gtest/gtest.h>

#include "sfmcpp/cameras/perspective.hpp"
#include "support/function_camera.hpp"
#include "support/random_batch.hpp"

namespace sfmcpp::residuals::function_images_test {
namespace {

constexpr int kCount = 13, kFirst = 4;
constexpr auto kModel = CameraModelId::kPerspective;

class FunctionImage : public testing::Test {
 protected:
  FunctionImage() { images_.set(kFirst, batch_.view()); }

  support::LensFunction<PerspectiveLens> function_;
  support::RandomBatch batch_{kModel, kCount};
  FunctionImages images_{function_, kFirst + kCount};
};

TEST_F(FunctionImage, ResidualsAreThoseOfTheKernel) {
  std::vector<double> u(kCount + kReadAhead), v(u), expected_u(u), expected_v(u);
  images_.evaluate(false);
  images_.residuals(kFirst, batch_.view(), u.data(), v.data());
  reprojection_kernels(kModel).residuals(batch_.view(), expected_u.data(), expected_v.data());
  for (int k = 0; k < kCount; ++k) {
    EXPECT_NEAR(u[k], expected_u[k], 1e-10 * (1.0 + std::abs(expected_u[k])));
    EXPECT_NEAR(v[k], expected_v[k], 1e-10 * (1.0 + std::abs(expected_v[k])));
  }
}

// With columns of zeros behind those of the free parameters.
TEST_F(FunctionImage, RecordsAreThoseOfTheKernel) {
  constexpr int kColumns = 12;
  const std::vector<int> free{0, 2, 5, 11};
  const auto linearized = [&](const auto& linearize) {
    std::vector<double> numbers(2 * kCount * (kColumns + 4), -1.0);
    linearize(JacobianOutput{free.data(),
                             static_cast<int>(free.size()),
                             kColumns,
                             numbers.data(),
                             numbers.data() + 2L * kCount * kColumns});
    return numbers;
  };
  images_.evaluate(true);
  const std::vector<double> found =
      linearized([&](const JacobianOutput& out) { images_.linearize(kFirst, batch_.view(), out); });
  const std::vector<double> expected = linearized([&](const JacobianOutput& out) {
    reprojection_kernels(kModel).linearize(batch_.view(), out);
  });
  for (std::size_t k = 0; k < found.size(); ++k)
    EXPECT_NEAR(found[k], expected[k], 1e-10 * (1.0 + std::abs(expected[k]))) << k;
}

TEST_F(FunctionImage, WhereAStepLeadsIsToSecondOrderWhatTheBendingKernelSays) {
  const std::vector<double> camera_step{0.02, -0.01, 0.03, 0.1, 0.05, -0.2};
  std::vector<double> intrinsics_step(12, 0.0), point_steps(batch_.points.size());
  intrinsics_step[0] = 3.0;
  intrinsics_step[5] = 0.05;
  for (std::size_t k = 0; k < point_steps.size(); ++k) point_steps[k] = 0.01 * double(k % 7);
  const std::vector<double> camera_bend{0.2, 0.1, -0.3, 0.3, -0.2, 0.1};
  const BendingBatch batch{.observations = batch_.view(),
                           .camera_step = camera_step.data(),
                           .camera_bend = camera_bend.data(),
                           .intrinsics_step = intrinsics_step.data(),
                           .point_steps = point_steps.data()};
  constexpr double kLength = 1e-3;
  std::vector<FunctionImages> along;
  for (const double length : {-kLength, 0.0, kLength}) {
    along.emplace_back(function_, kCount).set_along(0, batch, length);
    along.back().evaluate(false);
  }
  std::vector<double> u(kCount + kReadAhead), v(u);
  bending_kernel(kModel).bend(batch, u.data(), v.data());
  for (int k = 0; k < kCount; ++k) {
    const auto second = [&](int i) {
      return (along[0].pixel(k)[i] - 2.0 * along[1].pixel(k)[i] + along[2].pixel(k)[i]) *
             batch_.inverse_sigma[k] / (kLength * kLength);
    };
    EXPECT_NEAR(second(0), u[k], 1e-4 * (1.0 + std::abs(u[k])));
    EXPECT_NEAR(second(1), v[k], 1e-4 * (1.0 + std::abs(v[k])));
  }
}

}  // namespace
}  // namespace sfmcpp::residuals::function_images_test

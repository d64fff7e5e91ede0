// The nine sums of every instruction set and camera model against a plain loop over vectors.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <limits>
#include <random>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "sfmcpp/residuals/algebraic.hpp"
#include "support/kernel_cases.hpp"
#include "support/random_batch.hpp"

namespace sfmcpp::algebraic_kernels_test {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector4d;
using residuals::AlgebraicBatch;
using support::RandomBatch;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr int kMaxCount = 20;

// By the double-typed template, which cameras/camera_matrix_test.cpp tests.
Vector2d undistorted(CameraModelId model, const std::vector<double>& intrinsics, Vector2d seen) {
  Vector2d ideal;
  visit_camera(model, [&](auto type) {
    decltype(type)::template undistort<residuals::kLensSteps>(
        intrinsics.data(), seen[0], seen[1], ideal[0], ideal[1]);
  });
  return ideal;
}

// A batch whose camera, its change and the steps of its points are any numbers at all.
struct Scene {
  Scene(CameraModelId model, int count, unsigned seed) : batch(model, count), random(seed) {
    for (double& x : matrix) x = normal();
    for (double& x : change) x = normal();
    point_steps.resize(3UL * (count + 3));
    for (double& x : point_steps) x = 0.3 * normal();
    for (int k = 0; k < count; ++k) {
      batch.u[k] = 320.0 + 100.0 * normal();
      batch.v[k] = 240.0 + 100.0 * normal();
      ideal.push_back(undistorted(model, batch.intrinsics, {batch.u[k], batch.v[k]}));
    }
    shear.assign(count + kReadAhead, kNaN);
    stretch = shear;
    for (int k = 0; k < count; ++k) {
      shear[k] = normal();
      stretch[k] = 0.5 + std::abs(normal());
    }
    for (int k = count; k < count + kReadAhead; ++k)
      batch.u[k] = batch.v[k] = batch.inverse_sigma[k] = kNaN;
  }

  double normal() { return normal_distribution(random); }

  AlgebraicBatch view(bool weigh_by_depth) const {
    return {.observations = batch.view(),
            .matrix = matrix.data(),
            .change = change.data(),
            .point_steps = point_steps.data(),
            .centre_u = 310.0,
            .centre_v = 255.0,
            .scale = 130.0,
            .weigh_by_depth = weigh_by_depth,
            .shapes = shaped ? residuals::WhitenerShapes{shear.data(), stretch.data()}
                             : residuals::WhitenerShapes{}};
  }

  RandomBatch batch;
  std::array<double, 12> matrix, change;
  std::vector<double> point_steps, shear, stretch;
  bool shaped = false;
  std::vector<Vector2d> ideal;
  std::mt19937 random;
  std::normal_distribution<double> normal_distribution;
};

// (X, 1) and (δX, 0); or Q and the imaginary quaternion of the step times Q.
std::pair<Vector4d, Vector4d> point_and_change(const Scene& scene, int k) {
  const double* stored = scene.batch.stored_point(k);
  const Vector3d step(&scene.point_steps[3UL * scene.batch.point[k]]);
  if (is_metric(scene.batch.model))
    return {Vector4d(stored[0], stored[1], stored[2], 1.0), Vector4d(step[0], step[1], step[2], 0)};
  const Eigen::Quaterniond q(stored[0], stored[1], stored[2], stored[3]);
  const Eigen::Quaterniond dq = Eigen::Quaterniond(0.0, step[0], step[1], step[2]) * q;
  return {Vector4d(stored), Vector4d(dq.w(), dq.x(), dq.y(), dq.z())};
}

// Thesis eqs 4.8–4.14 in vectors: S is the first two rows of [q̂]×.
Biquadratic plain_sums(const Scene& scene, bool weigh_by_depth) {
  const AlgebraicBatch view = scene.view(weigh_by_depth);
  const Eigen::Map<const Matrix34> p(view.matrix), dp(view.change);
  Biquadratic sums;
  for (int k = 0; k < scene.batch.count; ++k) {
    const auto [q, dq] = point_and_change(scene, k);
    const double x = (scene.ideal[k].x() - view.centre_u) / view.scale;
    const double y = (scene.ideal[k].y() - view.centre_v) / view.scale;
    Eigen::Matrix<double, 2, 3> s;
    s << 0.0, -1.0, y, 1.0, 0.0, -x;
    // Of covariances: the rows that give the errors in u and v, and L of whitening.hpp.
    if (scene.shaped) {
      const double shear = scene.shear[k], stretch = scene.stretch[k];
      s << 1.0, 0.0, -x, shear, stretch, -shear * x - stretch * y;
    }
    s *= scene.batch.inverse_sigma[k];
    if (weigh_by_depth) s *= view.scale / (p * q)[2];
    const Vector2d a = s * p * q, bp = s * dp * q, bq = s * p * dq, c = s * dp * dq;
    sums.aa += a.dot(a);
    sums.ap += a.dot(bp);
    sums.aq += a.dot(bq);
    sums.pp += bp.dot(bp);
    sums.qq += bq.dot(bq);
    sums.pq += bp.dot(bq) + a.dot(c);
    sums.pc += bp.dot(c);
    sums.qc += bq.dot(c);
    sums.cc += c.dot(c);
  }
  return sums;
}

void expect_close(const Biquadratic& sums, const Biquadratic& expected) {
  const auto& [aa, ap, aq, pp, qq, pq, pc, qc, cc] = expected;
  const double a = std::sqrt(aa), p = std::sqrt(pp), q = std::sqrt(qq), c = std::sqrt(cc);
  constexpr double kTolerance = 1e-12;
  EXPECT_NEAR(sums.aa, aa, kTolerance * aa);
  EXPECT_NEAR(sums.ap, ap, kTolerance * a * p);
  EXPECT_NEAR(sums.aq, aq, kTolerance * a * q);
  EXPECT_NEAR(sums.pp, pp, kTolerance * pp);
  EXPECT_NEAR(sums.qq, qq, kTolerance * qq);
  EXPECT_NEAR(sums.pq, pq, kTolerance * (p * q + a * c));
  EXPECT_NEAR(sums.pc, pc, kTolerance * p * c);
  EXPECT_NEAR(sums.qc, qc, kTolerance * q * c);
  EXPECT_NEAR(sums.cc, cc, kTolerance * cc);
}

class AlgebraicKernelOf : public testing::TestWithParam<support::KernelCase> {
 protected:
  Biquadratic sums(const AlgebraicBatch& batch) const {
    const residuals::AlgebraicSums sums = GetParam().isa.algebraic(GetParam().model).sums(batch);
    std::array<double, residuals::kAlgebraicSums> values{};
    std::ranges::transform(sums.sums, sums.rests, values.begin(), std::plus<>());
    return std::bit_cast<Biquadratic>(values);
  }
};

// Beyond the batch there is nothing but NaN.
TEST_P(AlgebraicKernelOf, SumsAreThoseOfAPlainLoopOverTheBatchAndNothingBeyondIt) {
  for (int count = 1; count <= kMaxCount; ++count) {
    Scene scene(GetParam().model, count, 100 + count);
    for (bool shaped : {false, true}) {
      scene.shaped = shaped;
      for (bool weigh_by_depth : {false, true}) {
        SCOPED_TRACE(testing::Message() << count << (weigh_by_depth ? " by depth" : " alike"));
        expect_close(sums(scene.view(weigh_by_depth)), plain_sums(scene, weigh_by_depth));
      }
    }
  }
}

// In a solve, the observations of the next chunk follow those of a batch.
TEST_P(AlgebraicKernelOf, WhatFollowsABatchChangesNoBitOfItsSums) {
  for (int count = 1; count <= kMaxCount; ++count) {
    Scene scene(GetParam().model, count, 100 + count);
    const Biquadratic alone = sums(scene.view(true));
    for (int k = count; k < count + kReadAhead; ++k) {
      scene.batch.u[k] = 17.0 * k;
      scene.batch.v[k] = 1e300;
      scene.batch.inverse_sigma[k] = 3.0;
      scene.batch.point[k] = k % (count + 3);
    }
    const Biquadratic followed = sums(scene.view(true));
    EXPECT_EQ(alone.aa, followed.aa);
    EXPECT_EQ(alone.pq, followed.pq);
    EXPECT_EQ(alone.cc, followed.cc);
  }
}

// The weight 1/w² has no sign: a camera and minus that camera are the same camera.
TEST_P(AlgebraicKernelOf, SumsDoNotDependOnTheSignOfTheMatrix) {
  Scene scene(GetParam().model, kMaxCount, 5);
  const Biquadratic sums_of_p = sums(scene.view(true));
  for (double& x : scene.matrix) x = -x;
  for (double& x : scene.change) x = -x;
  expect_close(sums(scene.view(true)), sums_of_p);
}

TEST_P(AlgebraicKernelOf, AStepOfNothingLeavesOnlyTheErrorItself) {
  Scene scene(GetParam().model, kMaxCount, 6);
  scene.change.fill(0.0);
  std::fill(scene.point_steps.begin(), scene.point_steps.end(), 0.0);
  const Biquadratic still = sums(scene.view(false));
  EXPECT_GT(still.aa, 0.0);
  for (double sum :
       {still.ap, still.aq, still.pp, still.qq, still.pq, still.pc, still.qc, still.cc})
    EXPECT_EQ(sum, 0.0);
}

INSTANTIATE_TEST_SUITE_P(Kernels,
                         AlgebraicKernelOf,
                         testing::ValuesIn(support::all_kernel_cases()));

}  // namespace
}  // namespace sfmcpp::algebraic_kernels_test

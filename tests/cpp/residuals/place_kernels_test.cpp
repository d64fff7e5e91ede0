// Points at places of their own against the kernels for one camera, which other tests compare with
// the camera templates.
#include <array>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "sfmcpp/residuals/whitening.hpp"
#include "support/kernel_cases.hpp"
#include "support/random_batch.hpp"

namespace sfmcpp::place_kernels_test {
namespace {

using residuals::kPlaceLanes, residuals::kRecordSize;
using support::RandomBatch;

constexpr int kCameras = 4, kRows = 5;

// Twice ρ of Cauchy with c = 1, to be told from least squares.
void weigh(const void*, int count, const double* squared, double* rho, double* weight) {
  for (int k = 0; k < count; ++k) {
    rho[k] = std::log1p(squared[k]);
    weight[k] = 1.0 / (1.0 + squared[k]);
  }
}

// Lane l has point l of a batch of each camera, as often as l % kRows + 1 of them see it, camera
// after camera; the last camera twice.
class PlaceKernelCase : public testing::TestWithParam<support::KernelCase> {
 protected:
  PlaceKernelCase() : storage(point_storage(GetParam().model)) {
    for (int i = 0; i < kCameras; ++i) {
      RandomBatch batch(GetParam().model, kPlaceLanes);
      for (int k = 3; k < kCameraStorage; k += 4) batch.camera[k] += 0.05 * i;
      batch.intrinsics[0] *= 1.0 + 0.1 * i;
      for (int k = 0; k < kPlaceLanes; ++k) batch.point[k] = k;
      cameras.insert(cameras.end(), batch.camera.begin(), batch.camera.end());
      intrinsics.insert(intrinsics.end(), batch.intrinsics.begin(), batch.intrinsics.end());
      batches.push_back(batch);
    }
    for (int lane = 0; lane < kPlaceLanes; ++lane) {
      count[lane] = lane % kRows + 1;
      for (int k = 0; k < storage; ++k)
        places[kPlaceLanes * k + lane] = batches[0].stored_point(lane)[k];
    }
    for (int row = 0; row < kRows; ++row) {
      for (int lane = 0; lane < kPlaceLanes; ++lane) set(row, lane);
    }
  }

  void set(int row, int lane) {
    const int at = kPlaceLanes * row + lane, camera_of_row = std::min(row, kCameras - 1);
    if (row >= count[lane]) {
      u[at] = std::numeric_limits<double>::quiet_NaN();
      return;
    }
    const RandomBatch& batch = batches[camera_of_row];
    camera[at] = camera_of_row;
    u[at] = batch.u[lane];
    v[at] = batch.v[lane];
    inverse_sigma[at] = batch.inverse_sigma[lane];
    shear[at] = 0.1 * lane - 0.3;
    stretch[at] = 1.5 - 0.1 * row;
  }

  residuals::PlaceRows rows(bool shaped, bool robust) const {
    return {.cameras = cameras.data(),
            .intrinsics = intrinsics.data(),
            .num_rows = kRows,
            .camera = camera.data(),
            .intrinsics_row = camera.data(),
            .u = u.data(),
            .v = v.data(),
            .inverse_sigma = inverse_sigma.data(),
            .shear = shaped ? shear.data() : nullptr,
            .stretch = shaped ? stretch.data() : nullptr,
            .count = count.data(),
            .weigh = robust ? &weigh : nullptr,
            .loss = nullptr};
  }

  std::vector<double> records_of(const RandomBatch& batch) const {
    constexpr int kWidest = 2 * kMaxCameraTangent;
    std::vector<double> by_camera(static_cast<std::size_t>(kWidest) * batch.count);
    std::vector<double> records(static_cast<std::size_t>(kRecordSize) * batch.count);
    const int tangent = camera_tangent(batch.model);
    GetParam()
        .isa.reprojection(batch.model)
        .linearize(batch.view(), {nullptr, 0, tangent, by_camera.data(), records.data()});
    return records;
  }

  // V, Jᵀr and the cost of a lane: ten numbers.
  std::array<double, 10> expected(int lane, bool shaped, bool robust) const {
    std::array<double, 10> sums{};
    for (int row = 0; row < count[lane]; ++row) {
      const int at = kPlaceLanes * row + lane;
      std::vector<double> all = records_of(batches[camera[at]]);
      double* record = all.data() + static_cast<long>(kRecordSize) * lane;
      const residuals::WhitenerShapes shapes{shaped ? &shear[at] : nullptr, &stretch[at]};
      residuals::whiten(shapes, 1, {nullptr, 0, 0, nullptr, record});
      const double squared = residuals::squared_residual(record);
      double rho = squared, weight = 1.0;
      if (robust) weigh(nullptr, 1, &squared, &rho, &weight);
      sums[9] += rho;
      for (const double* a : {record, record + residuals::kRecordRow}) {
        int entry = 0;
        for (int k = 0; k < 3; ++k) {
          for (int j = 0; j <= k; ++j) sums[entry++] += weight * a[k] * a[j];
          sums[6 + k] += weight * a[k] * a[3];
        }
      }
    }
    return sums;
  }

  int storage;
  std::vector<RandomBatch> batches;
  std::vector<double> cameras, intrinsics;
  std::array<double, kPlaceLanes> count{};
  std::array<double, kMaxPointStorage * kPlaceLanes> places{};
  std::array<int, kRows * kPlaceLanes> camera{};
  std::array<double, kRows * kPlaceLanes> u{}, v{}, inverse_sigma{}, shear{}, stretch{};
};

TEST_P(PlaceKernelCase, SumsAreThoseOfEachCameraByItself) {
  for (const bool shaped : {false, true}) {
    for (const bool robust : {false, true}) {
      residuals::PlaceFits fits;
      std::array<double, kPlaceLanes> costs;
      const residuals::PlaceKernels kernels = GetParam().isa.places(GetParam().model);
      kernels.fit(rows(shaped, robust), places.data(), fits);
      kernels.cost(rows(shaped, robust), places.data(), costs.data());
      for (int lane = 0; lane < kPlaceLanes; ++lane) {
        const std::array<double, 10> known = expected(lane, shaped, robust);
        const auto near = [&](double value, int k) {
          EXPECT_NEAR(value, known[k], 1e-11 * (1.0 + std::abs(known[k])))
              << "lane " << lane << ", number " << k << ", " << shaped << robust;
        };
        for (int k = 0; k < 6; ++k) near(fits.v[k][lane], k);
        for (int k = 0; k < 3; ++k) near(fits.rhs[k][lane], 6 + k);
        near(fits.cost[lane], 9);
        near(costs[lane], 9);
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All,
                         PlaceKernelCase,
                         testing::ValuesIn(support::all_kernel_cases()),
                         &support::name_of_kernel_case);

}  // namespace
}  // namespace sfmcpp::place_kernels_test

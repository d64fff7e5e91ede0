// Points at places of their own against the kernels for one camera, which other tests compare with
// the camera templates.
#include <cmath>

#include <gtest/gtest.h>

#include "sfmcpp/residuals/reprojection.hpp"
#include "support/kernel_cases.hpp"
#include "support/random_batch.hpp"

namespace sfmcpp::place_kernels_test {
namespace {

using residuals::kReadAhead;
using support::RandomBatch;

constexpr int kRecord = 8;

class PlaceKernelCase : public testing::TestWithParam<support::KernelCase> {
 protected:
  std::vector<double> of_one_camera(const RandomBatch& batch) const {
    constexpr int kWidest = 2 * kMaxCameraTangent;
    std::vector<double> camera(static_cast<std::size_t>(kWidest) * batch.count);
    std::vector<double> records(static_cast<std::size_t>(kRecord) * batch.count);
    const int tangent = camera_tangent(batch.model);
    GetParam()
        .isa.reprojection(batch.model)
        .linearize(batch.view(), {nullptr, 0, tangent, camera.data(), records.data()});
    return records;
  }
};

// Odd observations are of a second camera, and the first is of none.
TEST_P(PlaceKernelCase, RecordsAreThoseOfEachCameraByItself) {
  for (int count : {1, 2, 7, 8, 9, 17}) {
    const CameraModelId model = GetParam().model;
    const RandomBatch first(model, count);
    RandomBatch second(model, count);
    for (int k = 3; k < kCameraStorage; k += 4) second.camera[k] += 0.05;
    second.intrinsics[0] *= 1.1;
    std::vector<double> cameras(kCameraStorage, 0.0), intrinsics(first.intrinsics.size(), 0.0);
    const auto append = [&](const RandomBatch& batch) {
      cameras.insert(cameras.end(), batch.camera.begin(), batch.camera.end());
      intrinsics.insert(intrinsics.end(), batch.intrinsics.begin(), batch.intrinsics.end());
    };
    append(first);
    append(second);
    std::vector<int> camera(count + kReadAhead, 0);
    for (int k = 0; k < count; ++k) camera[k] = 1 + k % 2;
    std::vector<double> records(static_cast<std::size_t>(kRecord) * count);
    GetParam().isa.places(model).linearize({.cameras = cameras.data(),
                                            .camera = camera.data(),
                                            .intrinsics = intrinsics.data(),
                                            .intrinsics_row = camera.data(),
                                            .places = first.points.data(),
                                            .place = first.point.data(),
                                            .u = first.u.data(),
                                            .v = first.v.data(),
                                            .inverse_sigma = first.inverse_sigma.data(),
                                            .count = count},
                                           records.data());
    const std::vector<double> expected[] = {of_one_camera(first), of_one_camera(second)};
    for (int e = 0; e < kRecord * count; ++e) {
      const double known = expected[e / kRecord % 2][e];
      EXPECT_NEAR(records[e], known, 1e-12 * (1.0 + std::abs(known))) << "number " << e;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All,
                         PlaceKernelCase,
                         testing::ValuesIn(support::all_kernel_cases()),
                         &support::name_of_kernel_case);

}  // namespace
}  // namespace sfmcpp::place_kernels_test

// The kernels of every instruction set against the double-typed camera templates, for batches of
// every length around the width of a pack.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include <Eigen/Core>
#include <gtest/gtest.h>

#include "sfmcpp/linear/parameter_map.hpp"
#include "support/camera_dispatch.hpp"
#include "support/kernel_cases.hpp"
#include "support/random_batch.hpp"

namespace sfmcpp::reprojection_kernels_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using residuals::JacobianOutput;
using residuals::ObservationBatch;
using residuals::ReprojectionKernels;
using support::RandomBatch;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

class ReprojectionKernel : public testing::TestWithParam<support::KernelCase> {};

TEST_P(ReprojectionKernel, ResidualsAreObservedMinusProjectedOverSigma) {
  for (int count = 1; count <= 20; ++count) {
    const RandomBatch batch(GetParam().model, count);
    std::vector<double> ru(count + kReadAhead, kNaN), rv(count + kReadAhead, kNaN);
    GetParam().isa.reprojection(GetParam().model).residuals(batch.view(), ru.data(), rv.data());
    for (int k = 0; k < count; ++k) {
      const ImagePoint<double> image = batch.image(k);
      const double scale = 1e-12 * batch.inverse_sigma[k];
      EXPECT_NEAR(ru[k],
                  (batch.u[k] - image.u) * batch.inverse_sigma[k],
                  scale * (1000 + std::abs(image.u)));
      EXPECT_NEAR(rv[k],
                  (batch.v[k] - image.v) * batch.inverse_sigma[k],
                  scale * (1000 + std::abs(image.v)));
    }
  }
}

TEST_P(ReprojectionKernel, CountsThePointsNotInFrontOfTheCamera) {
  for (int count = 1; count <= 20; ++count) {
    const RandomBatch batch(GetParam().model, count);
    int behind = 0;
    for (int k = 0; k < count; ++k) behind += batch.image(k).depth <= 0.0;
    std::vector<double> ru(count + kReadAhead), rv(count + kReadAhead);
    EXPECT_EQ(
        GetParam().isa.reprojection(GetParam().model).residuals(batch.view(), ru.data(), rv.data()),
        behind);
  }
}

// The arrays hold other numbers beyond the end of the batch: they must not count.
TEST_P(ReprojectionKernel, TheCostOfABatchIsTheSumOverItsObservationsAlone) {
  for (int count = 1; count <= 20; ++count) {
    const RandomBatch batch(GetParam().model, count);
    double squares = 0.0, behind = 0.0;
    for (int k = 0; k < count; ++k) {
      const ImagePoint<double> image = batch.image(k);
      squares += std::pow((batch.u[k] - image.u) * batch.inverse_sigma[k], 2) +
                 std::pow((batch.v[k] - image.v) * batch.inverse_sigma[k], 2);
      behind += image.depth <= 0.0;
    }
    const residuals::BatchCost cost = GetParam().isa.cost(GetParam().model).cost(batch.view());
    EXPECT_NEAR(cost.squares.total().value(), squares, 1e-12 * squares);
    EXPECT_EQ(cost.behind_camera, behind);
  }
}

TEST_P(ReprojectionKernel, AResidualThatIsNoNumberMakesTheCostNone) {
  RandomBatch batch(GetParam().model, 11);
  for (auto* values : {&batch.u, &batch.v}) std::fill(values->begin() + 11, values->end(), kNaN);
  EXPECT_TRUE(std::isfinite(
      GetParam().isa.cost(GetParam().model).cost(batch.view()).squares.total().value()));
  batch.v[10] = kNaN;
  EXPECT_TRUE(
      std::isnan(GetParam().isa.cost(GetParam().model).cost(batch.view()).squares.total().value()));
}

// So that a state costs the same, whether it is linearised there or not.
TEST_P(ReprojectionKernel, SquaresOfRecordsInPartsHaveTheBitsOfTheCost) {
  const residuals::CostKernels kernels = GetParam().isa.cost(GetParam().model);
  for (int count = 1; count <= 40; ++count) {
    const RandomBatch batch(GetParam().model, count);
    const int size = linear::padded_camera_size(camera_tangent(GetParam().model));
    std::vector<double> camera(2UL * size * count), records(8UL * count);
    GetParam()
        .isa.reprojection(GetParam().model)
        .linearize(batch.view(),
                   {.free_intrinsics = nullptr,
                    .num_free_intrinsics = 0,
                    .camera_size = size,
                    .camera = camera.data(),
                    .point = records.data()});
    residuals::SumOfSquares lanes;
    for (int first = 0; first < count; first += 16)
      kernels.add_squares(std::min(16, count - first), records.data() + 8L * first, lanes);
    EXPECT_EQ(lanes.total().value(), kernels.cost(batch.view()).squares.total().value());
  }
}

// Which intrinsic parameters have a column, and how wide a camera block is: with the six columns of
// a free sensor of a rig too.
struct Layout {
  std::vector<int> free;
  int camera_size;
};

std::vector<Layout> layouts(CameraModelId model) {
  if (model == CameraModelId::kCalibrated) return {{{}, 6}, {{}, 12}};
  if (model == CameraModelId::kProjective) return {{{}, 12}};
  if (model == CameraModelId::kBal)
    return {{{}, 6}, {{0}, 9}, {{0, 2}, 9}, {{0, 1, 2}, 9}, {{}, 12}, {{0}, 18}, {{0, 1, 2}, 18}};
  std::vector<int> all(intrinsic_names(model).size());
  std::iota(all.begin(), all.end(), 0);
  if (model == CameraModelId::kPlugin) return {{{}, 6}, {{0}, 9}, {{0}, 18}, {all, 18}};
  return {{{}, 6}, {{0, 5, 11}, 9}, {{0, 2, 3, 5, 6}, 12}, {{0}, 18}, {all, 18}};
}

// 2 × camera_size and 2 × 4 of one observation, by the double-typed template.
template <class Camera>
std::pair<MatrixXd, MatrixXd> expected_of(const RandomBatch& batch, const Layout& layout, int k) {
  constexpr int kTangent = Camera::kTangent;
  LinearizedImagePoint<double, kTangent, Camera::kIntrinsics> lin{};
  Camera::linearize(batch.camera.data(), batch.intrinsics.data(), batch.stored_point(k), lin);
  MatrixXd camera = MatrixXd::Zero(2, layout.camera_size), point(2, 4);
  const double observed[2] = {batch.u[k], batch.v[k]}, projected[2] = {lin.image.u, lin.image.v};
  for (int row = 0; row < 2; ++row) {
    for (int c = 0; c < kTangent; ++c) camera(row, c) = lin.camera[row][c];
    for (std::size_t c = 0; c < layout.free.size(); ++c) {
      camera(row, kTangent + c) = lin.intrinsics[row][layout.free[c]];
    }
    for (int c = 0; c < 3; ++c) point(row, c) = lin.point[row][c];
    point(row, 3) = observed[row] - projected[row];
  }
  return {camera * batch.inverse_sigma[k], point * batch.inverse_sigma[k]};
}

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

double relative_error(const MatrixXd& actual, const MatrixXd& expected) {
  const double error = (actual - expected).cwiseAbs().maxCoeff() / expected.cwiseAbs().maxCoeff();
  return actual.allFinite() ? error : std::numeric_limits<double>::infinity();
}

TEST_P(ReprojectionKernel, JacobiansAreThoseOfTheCameraModelOverSigma) {
  for (const Layout& layout : layouts(GetParam().model)) {
    for (int count = 1; count <= 20; ++count) {
      const RandomBatch batch(GetParam().model, count);
      const int size = layout.camera_size;
      std::vector<double> camera(2L * count * size, kNaN), point(8L * count, kNaN);
      const int num_free = static_cast<int>(layout.free.size());
      GetParam()
          .isa.reprojection(GetParam().model)
          .linearize(batch.view(),
                     {layout.free.data(), num_free, size, camera.data(), point.data()});
      for (int k = 0; k < count; ++k) {
        const auto [camera_expected, point_expected] = visit_camera(
            batch.model, [&](auto type) { return expected_of<decltype(type)>(batch, layout, k); });
        const Eigen::Map<const RowMajor> camera_actual(camera.data() + 2L * k * size, 2, size);
        const Eigen::Map<const RowMajor> point_actual(point.data() + 8L * k, 2, 4);
        EXPECT_LT(relative_error(camera_actual, camera_expected), 1e-12);
        EXPECT_LT(relative_error(point_actual, point_expected), 1e-12);
      }
    }
  }
}

TEST_P(ReprojectionKernel, WritesNothingBeyondTheRecordsOfTheBatch) {
  for (const Layout& layout : layouts(GetParam().model)) {
    for (int count = 1; count <= 20; ++count) {
      const RandomBatch batch(GetParam().model, count);
      const long size = 2L * count * layout.camera_size;
      constexpr int kGuard = 64;
      std::vector<double> camera(size + 2 * kGuard, 42.0), point(8L * count + 2 * kGuard, 42.0);
      GetParam()
          .isa.reprojection(GetParam().model)
          .linearize(batch.view(),
                     {layout.free.data(),
                      static_cast<int>(layout.free.size()),
                      layout.camera_size,
                      camera.data() + kGuard,
                      point.data() + kGuard});
      for (int k = 0; k < kGuard; ++k) {
        ASSERT_EQ(camera[k] + point[k], 84.0) << "before the records, " << count << " observations";
        ASSERT_EQ(camera[camera.size() - 1 - k] + point[point.size() - 1 - k], 84.0)
            << "beyond the records, " << count << " observations";
      }
    }
  }
}

TEST_P(ReprojectionKernel, ResidualsGoAtMostReadAheadBeyondTheBatch) {
  for (int count = 1; count <= 20; ++count) {
    const RandomBatch batch(GetParam().model, count);
    std::vector<double> ru(count + kReadAhead + 8, 42.0), rv = ru;
    GetParam().isa.reprojection(GetParam().model).residuals(batch.view(), ru.data(), rv.data());
    for (std::size_t k = count + kReadAhead; k < ru.size(); ++k) ASSERT_EQ(ru[k] + rv[k], 84.0);
  }
}

// What a lane computes must not depend on its neighbours: a solve cuts batches as it likes.
TEST_P(ReprojectionKernel, AnObservationHasTheSameBitsInEveryBatch) {
  const RandomBatch whole(GetParam().model, 20);
  std::vector<double> ru(20 + kReadAhead), rv(20 + kReadAhead), one_u(1 + kReadAhead),
      one_v(1 + kReadAhead);
  GetParam().isa.reprojection(GetParam().model).residuals(whole.view(), ru.data(), rv.data());
  for (int k = 0; k < 12; ++k) {
    ObservationBatch one = whole.view();
    one.point += k;
    one.u += k;
    one.v += k;
    one.inverse_sigma += k;
    one.count = 1;
    GetParam().isa.reprojection(GetParam().model).residuals(one, one_u.data(), one_v.data());
    EXPECT_EQ(one_u[0], ru[k]);
    EXPECT_EQ(one_v[0], rv[k]);
  }
}

INSTANTIATE_TEST_SUITE_P(Kernels,
                         ReprojectionKernel,
                         testing::ValuesIn(support::all_kernel_cases()));

}  // namespace
}  // namespace sfmcpp::reprojection_kernels_test

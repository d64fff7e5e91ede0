// The sums of every instruction set against plain loops over the double-typed camera templates.
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "sfmcpp/cameras/matrix34.hpp"
#include "sfmcpp/cameras/visit_camera.hpp"
#include "sfmcpp/math/so3.hpp"
#include "sfmcpp/residuals/resection.hpp"
#include "support/instruction_sets.hpp"
#include "support/whitening_factor.hpp"

namespace sfmcpp::resection_kernels_test {
namespace {

using Eigen::Matrix;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using residuals::PointViews;
using residuals::PoseSums;
using residuals::ViewArrays;
using Vector6 = Matrix<double, 6, 1>;
using Matrix6 = Matrix<double, 6, 6>;

struct Scene {
  Scene(CameraModelId model_id, int count, unsigned seed) : model(model_id), random(seed) {
    const double sign = model == CameraModelId::kBal ? -1.0 : 1.0;
    for (int j = 0; j < count; ++j) {
      const double depth = sign * (6.0 + normal());
      for (double x : {normal(), normal(), depth}) points.push_back(x);
      for (int k = 0; k < 2; ++k) pixels.push_back(100.0 * normal());
      sigma.push_back(0.5 + std::abs(normal()));
    }
    for (auto* p : {&pose, &other}) {
      Matrix34 m;
      m << exp_so3(0.1 * Eigen::Vector3d(normal(), normal(), normal())),
          0.3 * Eigen::Vector3d(normal(), normal(), normal());
      Eigen::Map<Matrix34>{p->data()} = m;
    }
    intrinsics.assign(intrinsic_names(model).size(), 0.01);
    intrinsics[0] = 500.0;
    if (model != CameraModelId::kBal) intrinsics[1] = 1.1;
  }
  double normal() { return normal_distribution(random); }

  CameraModelId model;
  std::mt19937 random;
  std::normal_distribution<double> normal_distribution;
  std::vector<double> points, pixels, sigma, intrinsics;
  std::array<double, 12> pose, other;
};

// J (2n × 6) and the image of every point.
struct Images {
  MatrixXd jacobian;
  VectorXd pixels;
  std::vector<double> depth;
};

Images images_of(const Scene& s, const std::array<double, 12>& pose) {
  const int count = static_cast<int>(s.sigma.size());
  Images out{MatrixXd(2 * count, 6), VectorXd(2 * count), {}};
  visit_camera(s.model, [&](auto type) {
    using Camera = decltype(type);
    if constexpr (Camera::kMetric) {
      for (int j = 0; j < count; ++j) {
        LinearizedImagePoint<double, 6, Camera::kIntrinsics> at;
        Camera::linearize(pose.data(), s.intrinsics.data(), s.points.data() + 3L * j, at);
        out.pixels.segment<2>(2 * j) << at.image.u, at.image.v;
        out.depth.push_back(at.image.depth);
        for (int k = 0; k < 12; ++k) out.jacobian(2 * j + k / 6, k % 6) = at.camera[k / 6][k % 6];
      }
    }
  });
  return out;
}

VectorXd weights_of(const Scene& s) {
  VectorXd w(2 * s.sigma.size());
  for (Eigen::Index k = 0; k < w.size(); ++k) w[k] = 1.0 / s.sigma[k / 2];
  return w;
}

void expect_sums(const PoseSums& got, const MatrixXd& j, const VectorXd& r) {
  const Matrix6 normal = j.transpose() * j;
  const Vector6 gradient = j.transpose() * r;
  int next = 0;
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column <= row; ++column, ++next)
      EXPECT_NEAR(got.normal[next], normal(row, column), 1e-12 * normal.norm());
    EXPECT_NEAR(got.gradient[row], gradient[row], 1e-12 * j.norm() * r.norm());
  }
  EXPECT_NEAR(got.cost, r.squaredNorm(), 1e-12 * r.squaredNorm());
}

class ResectionKernelsOf : public testing::TestWithParam<CameraModelId> {
 protected:
  // Every instruction set, and counts on both sides of whole packs.
  template <class F>
  void for_every_case(const F& f) const {
    for (const support::InstructionSet& set : support::instruction_sets()) {
      for (int count : {1, 7, 8, 9, 20}) {
        SCOPED_TRACE(std::string(set.name) + ", " + std::to_string(count));
        const Scene scene(GetParam(), count, 17u + count);
        const PointViews views(scene.points, scene.pixels, scene.sigma);
        f(set.resection(GetParam()), scene, views.arrays());
      }
    }
  }
};

TEST_P(ResectionKernelsOf, SumsAreThoseOfTheNormalEquations) {
  for_every_case([](auto kernels, const Scene& s, const ViewArrays& views) {
    PoseSums got;
    kernels.sums(views, s.intrinsics.data(), s.pose.data(), views.inverse_sigma, got);
    const Images at = images_of(s, s.pose);
    const VectorXd w = weights_of(s);
    const VectorXd seen = VectorXd::Map(s.pixels.data(), w.size());
    expect_sums(got, w.asDiagonal() * at.jacobian, w.cwiseProduct(seen - at.pixels));
  });
}

TEST_P(ResectionKernelsOf, RowsAreTheJacobianAndTheResidual) {
  for_every_case([](auto kernels, const Scene& s, const ViewArrays& views) {
    std::vector<double> rows(residuals::kViewRows * views.padded);
    kernels.rows(views, s.intrinsics.data(), s.pose.data(), rows.data());
    const Images at = images_of(s, s.pose);
    const double scale = at.jacobian.cwiseAbs().maxCoeff();
    for (int j = 0; j < views.count; ++j) {
      for (int k = 0; k < 12; ++k) {
        EXPECT_NEAR(rows[k * views.padded + j],
                    at.jacobian(2 * j + k / 6, k % 6) / s.sigma[j],
                    1e-12 * scale);
      }
      for (int k = 0; k < 2; ++k) {
        EXPECT_NEAR(rows[(12 + k) * views.padded + j],
                    (s.pixels[2 * j + k] - at.pixels[2 * j + k]) / s.sigma[j],
                    1e-10);
      }
    }
  });
}

TEST_P(ResectionKernelsOf, ErrorsAreSquaredResidualsAndInfiniteBehindTheCamera) {
  for_every_case([](auto kernels, Scene s, const ViewArrays&) {
    s.points[2] *= -1.0;
    const PointViews behind(s.points, s.pixels, s.sigma);
    const ViewArrays views = behind.arrays();
    std::vector<double> errors(views.padded);
    kernels.squared_errors(views, s.intrinsics.data(), s.pose.data(), errors.data());
    const Images at = images_of(s, s.pose);
    const VectorXd w = weights_of(s);
    const VectorXd r = w.cwiseProduct(VectorXd::Map(s.pixels.data(), w.size()) - at.pixels);
    for (int j = 0; j < views.count; ++j) {
      const double expected = r.segment<2>(2 * j).squaredNorm();
      if (at.depth[j] > 0.0) {
        EXPECT_NEAR(errors[j], expected, 1e-11 * expected);
      } else {
        EXPECT_EQ(errors[j], std::numeric_limits<double>::infinity());
      }
    }
    EXPECT_LT(*std::min_element(at.depth.begin(), at.depth.end()), 0.0);
  });
}

TEST_P(ResectionKernelsOf, SumsBetweenTwoPosesCompareTheirImages) {
  for_every_case([](auto kernels, const Scene& s, const ViewArrays& views) {
    const Images here = images_of(s, s.pose), there = images_of(s, s.other);
    const VectorXd w = weights_of(s), r = w.cwiseProduct(there.pixels - here.pixels);
    for (bool same_centre : {false, true}) {
      PoseSums got;
      kernels.sums_between(
          views, s.intrinsics.data(), s.pose.data(), s.other.data(), same_centre, got);
      MatrixXd j = here.jacobian;
      if (same_centre) j.rightCols<3>() -= there.jacobian.rightCols<3>();
      expect_sums(got, w.asDiagonal() * j, r);
    }
  });
}

// A prediction error is what the closed form promises: the residual left by the linear fit to all
// the other observations.
TEST_P(ResectionKernelsOf, PredictedErrorsAreThoseOfLinearFitsToTheOthers) {
  for_every_case([](auto kernels, const Scene& s, const ViewArrays& views) {
    const VectorXd w = weights_of(s);
    const Images at = images_of(s, s.pose);
    const MatrixXd j = w.asDiagonal() * at.jacobian;
    const VectorXd r = w.cwiseProduct(VectorXd::Map(s.pixels.data(), w.size()) - at.pixels);
    const Matrix6 prior = 0.1 * (j.transpose() * j).trace() * Matrix6::Identity();
    const Vector6 pull = Vector6::LinSpaced(-1.0, 1.0);
    const Matrix6 m = j.transpose() * j + prior;
    const Vector6 b = j.transpose() * r + pull;
    const Vector6 shift = m.llt().solve(b);
    const Matrix6 inverse = m.llt().matrixL().solve(Matrix6::Identity());
    double whitener[21], *next = whitener;
    for (int row = 0; row < 6; ++row) {
      for (int column = 0; column <= row; ++column) *next++ = inverse(row, column);
    }
    std::vector<double> rows(residuals::kViewRows * views.padded), errors(views.padded);
    kernels.rows(views, s.intrinsics.data(), s.pose.data(), rows.data());
    kernels.predicted_errors(rows.data(), views.padded, whitener, shift.data(), errors.data());
    for (int left_out = 0; left_out < views.count; ++left_out) {
      const auto jj = j.middleRows<2>(2 * left_out);
      const auto rj = r.segment<2>(2 * left_out);
      const Matrix6 others = m - jj.transpose() * jj;
      const Vector6 step = others.ldlt().solve(b - jj.transpose() * rj);
      const double expected = (rj - jj * step).squaredNorm();
      EXPECT_NEAR(errors[left_out], expected, 1e-9 * expected);
    }
  });
}

// Sums, rows and errors with Σ in place of σ.
TEST_P(ResectionKernelsOf, CovariancesWhitenBothRowsOfAnObservation) {
  for_every_case([](auto kernels, Scene s, const ViewArrays&) {
    const auto count = static_cast<Eigen::Index>(s.sigma.size());
    std::vector<double> covariances;
    MatrixXd whitening = MatrixXd::Zero(2 * count, 2 * count);
    for (Eigen::Index j = 0; j < count; ++j) {
      const double uu = 0.5 + std::abs(s.normal()), vv = 0.5 + std::abs(s.normal());
      const double uv = 0.8 * std::tanh(s.normal()) * std::sqrt(uu * vv);
      covariances.insert(covariances.end(), {uu, uv, uv, vv});
      whitening.block<2, 2>(2 * j, 2 * j) = support::whitening_factor(covariances.data() + 4 * j);
    }
    const PointViews owner(s.points, s.pixels, {}, covariances);
    const ViewArrays views = owner.arrays();
    const Images at = images_of(s, s.pose);
    const MatrixXd jacobian = whitening * at.jacobian;
    const VectorXd r = whitening * (VectorXd::Map(s.pixels.data(), 2 * count) - at.pixels);
    PoseSums got;
    kernels.sums(views, s.intrinsics.data(), s.pose.data(), views.inverse_sigma, got);
    expect_sums(got, jacobian, r);
    std::vector<double> rows(residuals::kViewRows * views.padded), errors(views.padded);
    kernels.rows(views, s.intrinsics.data(), s.pose.data(), rows.data());
    kernels.squared_errors(views, s.intrinsics.data(), s.pose.data(), errors.data());
    for (int j = 0; j < views.count; ++j) {
      for (int k = 0; k < 14; ++k) {
        const int row = 2 * j + (k < 12 ? k / 6 : k - 12);
        const double expected = k < 12 ? jacobian(row, k % 6) : r[row];
        const double scale = k < 12 ? jacobian.cwiseAbs().maxCoeff() : r.cwiseAbs().maxCoeff();
        EXPECT_NEAR(rows[k * views.padded + j], expected, 1e-12 * scale);
      }
      if (at.depth[j] > 0.0) {
        EXPECT_NEAR(errors[j] / r.segment<2>(2 * j).squaredNorm(), 1.0, 1e-11);
      }
    }
  });
}

INSTANTIATE_TEST_SUITE_P(MetricModels,
                         ResectionKernelsOf,
                         testing::Values(CameraModelId::kCalibrated, CameraModelId::kPerspective));

TEST(ResectionKernels, RefuseACameraWithoutAPose) {
  EXPECT_THROW(residuals::resection_kernels(CameraModelId::kProjective), InvalidArgument);
}

}  // namespace
}  // namespace sfmcpp::resection_kernels_test

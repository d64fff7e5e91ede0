// What a sweep over weights tells beside its poses, and what it refuses.
#include <algorithm>
#include <cmath>
#include <string>

#include <gtest/gtest.h>

#include "sfmcpp/ba/pose_refinement.hpp"
#include "support/pose_scene.hpp"

namespace sfmcpp::pose_sweep_test {
namespace {

using ba::PoseSweep;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using support::dense_fit;
using support::distance;
using support::moved;
using support::Pose;
using support::pose_of;
using support::prediction_error;
using support::stacked;
using Kind = residuals::ConstraintKind;
using Scene = support::PoseScene;

const std::vector<double> kWeights{0.0, 0.01, 0.3, 3.0, 30.0, 1000.0};

TEST(PoseSweep, OtherConstraintsKeepTheirWeight) {
  Scene s(Kind::kDisplacementRotation);
  s.constraints.push_back(Scene(Kind::kScale).constraints[0]);
  s.constraints[1].weight = 7.0;
  const PoseSweep sweep = s.sweep(kWeights);
  for (std::size_t k = 0; k < kWeights.size(); ++k) {
    const Pose expected = dense_fit(s, {kWeights[k], 7.0}, s.start);
    EXPECT_LT(distance(sweep.poses.data() + 12 * k, expected.data()), 2e-8);
    const double held = stacked(s, {0.0, 7.0}, expected).squaredNorm() -
                        stacked(s, {0.0, 0.0}, expected).squaredNorm();
    EXPECT_NEAR(sweep.held[k], held, 1e-6 * (1.0 + held));
  }
  s.constraints[0].weight = 3.0;
  const auto refined = ba::refine_pose(s.view(), s.constraints, s.start.data(), {});
  EXPECT_LT(distance(refined.pose.data(), dense_fit(s, {3.0, 7.0}, s.start).data()), 2e-8);
  ASSERT_EQ(refined.constraints.size(), 2u);
  EXPECT_NEAR(refined.constraints[0], sweep.constraint[3], 1e-9);
}

TEST(PoseSweep, CovariancesWeighImagesAsADenseFitDoes) {
  Scene s(Kind::kDisplacementRotation, 0.5, 12);
  s.give_covariances();
  const PoseSweep sweep = s.sweep(kWeights);
  for (std::size_t k = 0; k < kWeights.size(); ++k) {
    const Pose expected = dense_fit(s, {kWeights[k]}, s.start);
    EXPECT_LT(distance(sweep.poses.data() + 12 * k, expected.data()), 2e-8) << kWeights[k];
    const double score = support::refitted_score(s, kWeights[k], expected);
    EXPECT_NEAR(sweep.leave_one_out[k], score, 1e-5 * score);
    EXPECT_NEAR(sweep.approximate_leave_one_out[k], score, 0.1 * score);
    int near = 0;
    for (int j = 0; j < s.view().count(); ++j) {
      Scene in_pixels = s;
      in_pixels.covariances.clear();
      near += prediction_error(in_pixels, j, expected) * s.sigma[j] * s.sigma[j] <= 4.0;
    }
    EXPECT_EQ(sweep.inliers[k], near);
  }
}

TEST(PoseSweep, RoundCovariancesHaveTheBitsOfStandardDeviations) {
  Scene s(Kind::kPosition);
  const PoseSweep by_sigma = s.sweep(kWeights);
  for (double sigma : s.sigma)
    for (double x : {sigma * sigma, 0.0, 0.0, sigma * sigma}) s.covariances.push_back(x);
  const PoseSweep by_covariance = s.sweep(kWeights);
  EXPECT_EQ(by_covariance.poses, by_sigma.poses);
  EXPECT_EQ(by_covariance.leave_one_out, by_sigma.leave_one_out);
}

TEST(PoseSweep, CountsPointsWithinTwoPixelsWhateverTheirSigma) {
  const Scene s(Kind::kPosition, 1.5);
  const PoseSweep sweep = s.sweep(kWeights);
  for (std::size_t k = 0; k < kWeights.size(); ++k) {
    Pose pose;
    std::copy_n(sweep.poses.data() + 12 * k, 12, pose.begin());
    int expected = 0;
    for (int j = 0; j < s.view().count(); ++j)
      expected += prediction_error(s, j, pose) * s.sigma[j] * s.sigma[j] <= 4.0;
    EXPECT_EQ(sweep.inliers[k], expected);
  }
  EXPECT_LT(sweep.inliers.back(), sweep.inliers.front());
}

TEST(PoseSweep, FindsTheTruthOfPerfectImages) {
  const PoseSweep sweep = Scene(Kind::kPosition, 0.0).sweep({0.0});
  EXPECT_LT(sweep.vision[0], 1e-20);
  const Pose truth = pose_of(exp_so3({0.05, -0.1, 0.02}), {0.3, -0.2, 0.5});
  EXPECT_LT(distance(sweep.poses.data(), truth.data()), 1e-12);
  EXPECT_LT(sweep.leave_one_out[0], 1e-18);
}

TEST(PoseSweep, ReachesTheMinimumFromFarAway) {
  Scene s(Kind::kPosition);
  const PoseSweep near = s.sweep({0.0});
  s.start = pose_of(exp_so3({0.2, 0.3, -0.4}), {1.5, -1.0, -3.0});
  const PoseSweep far = s.sweep({0.0});
  EXPECT_LT(distance(near.poses.data(), far.poses.data()), 1e-9);
}

TEST(PoseSweep, RepeatsItselfBitByBit) {
  const Scene s(Kind::kDisplacementPose);
  const PoseSweep a = s.sweep(kWeights), b = s.sweep(kWeights);
  EXPECT_EQ(a.poses, b.poses);
  EXPECT_EQ(a.leave_one_out, b.leave_one_out);
  EXPECT_EQ(a.approximate_leave_one_out, b.approximate_leave_one_out);
}

TEST(PoseSweep, HasTheSameBitsForEveryNumberOfThreads) {
  const Scene s(Kind::kScale);
  const PoseSweep one = s.sweep(kWeights, {.threads = 1});
  for (int threads : {0, 2, 3, 5}) {
    const PoseSweep more = s.sweep(kWeights, {.threads = threads});
    EXPECT_EQ(one.poses, more.poses);
    EXPECT_EQ(one.leave_one_out, more.leave_one_out);
  }
}

TEST(PoseLinearization, IsTheOneOfTheStackedResiduals) {
  Scene s(Kind::kDisplacementPose);
  s.constraints.push_back(Scene(Kind::kScale).constraints[0]);
  const auto at = ba::linearize_pose(s.view(), s.constraints, s.start.data());
  const int n = s.view().count();
  const auto f = [&](const VectorXd& delta) {
    return stacked(s, {1.0, 1.0}, moved(s.start, delta));
  };
  const MatrixXd j = numeric_jacobian(f, VectorXd::Constant(6, 1e-4));
  const MatrixXd vision = j.topRows(2 * n);
  const VectorXd e = stacked(s, {1.0, 1.0}, s.start);
  const double scale = at.vision_normal.norm();
  EXPECT_LT((at.vision_normal - n * vision.transpose() * vision).norm(), 1e-7 * scale);
  EXPECT_LT((at.vision_gradient + n * vision.transpose() * e.head(2 * n)).norm(), 1e-6 * scale);
  EXPECT_LT((at.jacobians[0] - j.middleRows(2 * n, 12)).norm(), 1e-7);
  EXPECT_LT((at.jacobians[1] - j.bottomRows(1)).norm(), 1e-7);
  EXPECT_LT((at.residuals[0] - e.segment(2 * n, 12)).norm(), 1e-12);
}

std::string complaint(const Scene& s, const std::vector<double>& weights = {1.0}) {
  try {
    s.sweep(weights);
  } catch (const InvalidArgument& e) {
    return e.what();
  }
  return "";
}

TEST(PoseSweepCheck, NamesTheArgumentTheValueAndTheRule) {
  const Scene fine(Kind::kDisplacementPose);
  EXPECT_EQ(complaint(fine), "");
  EXPECT_EQ(complaint(fine, {1.0, -2.0}),
            "weights[1] = -2.000000: must be finite and not negative");
  EXPECT_EQ(complaint(Scene(Kind::kPosition, 1.0, 3)),
            "points: 3, must be at least 4 to leave one out");
  Scene s = fine;
  s.sigma[2] = 0.0;
  EXPECT_EQ(complaint(s), "sigma_px[2] = 0.000000: must be positive");
  s = fine;
  s.points.pop_back();
  EXPECT_EQ(complaint(s), "points: 89 numbers, must be 90");
  s = fine;
  s.pixels[3] = std::nan("");
  EXPECT_EQ(complaint(s), "pixels[3] = nan: must be finite");
  s = fine;
  s.start[0] = 2.0;
  EXPECT_NE(complaint(s).find("start: its left 3×3 block must be a rotation"), std::string::npos);
  s = fine;
  s.constraints[0].previous[0] = 2.0;
  EXPECT_NE(complaint(s).find("constraints[0].previous"), std::string::npos);
  EXPECT_THROW(
      ba::sweep_pose_weights(fine.view(), fine.constraints, 1, kWeights, fine.start.data(), {}),
      InvalidArgument);
  EXPECT_THROW(fine.sweep(kWeights, {.max_iterations = 0}), InvalidArgument);
  EXPECT_THROW(fine.sweep(kWeights, {.inlier_px = -1.0}), InvalidArgument);
  EXPECT_THROW(fine.sweep(kWeights, {.threads = -1}), InvalidArgument);
  EXPECT_THROW(fine.sweep(kWeights, {.threads = 1025}), InvalidArgument);
}

}  // namespace
}  // namespace sfmcpp::pose_sweep_test

// One pose to fit, and a dense Gauss–Newton fit with numeric derivatives to compare with.
#pragma once

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include <Eigen/Geometry>
#include <Eigen/QR>

#include "sfmcpp/ba/pose_refinement.hpp"
#include "sfmcpp/cameras/calibrated.hpp"
#include "sfmcpp/cameras/matrix34.hpp"
#include "sfmcpp/cameras/pose.hpp"
#include "sfmcpp/math/numeric_diff.hpp"
#include "sfmcpp/math/so3.hpp"
#include "support/constraint_setting.hpp"
#include "support/whitening_factor.hpp"

namespace sfmcpp::support {

using ConstraintKind = residuals::ConstraintKind;
using Pose = PoseNumbers;

// Points 4 to 20 m before a camera, seen with noise; a sensor that is off by some centimetres and
// hundredths of a radian.
struct PoseScene {
  explicit PoseScene(ConstraintKind kind, double noise_px = 1.0, int count = 30, unsigned seed = 5)
      : random(seed) {
    const Pose truth = pose_of(exp_so3({0.05, -0.1, 0.02}), {0.3, -0.2, 0.5});
    for (int j = 0; j < count; ++j) observe(truth, noise_px);
    const Eigen::Vector3d off(0.02, -0.01, 0.015);
    constraints.push_back(
        {.constraint = {.kind = kind,
                        .rotation = exp_so3({0.05, -0.1, 0.02}) * exp_so3(off),
                        .translation = Eigen::Vector3d(0.3, -0.2, 0.5) + 3.0 * off,
                        .distance = 0.65,
                        .points = points,
                        .intrinsics = intrinsics},
         .previous = pose_of(Eigen::Matrix3d::Identity(), Eigen::Vector3d::Zero())});
    start = pose_of(exp_so3({0.02, -0.05, 0.0}), {0.2, 0.0, 0.3});
  }

  void observe(const Pose& truth, double noise_px) {
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    std::normal_distribution<double> normal;
    const double depth = 12.0 + 8.0 * uniform(random);
    const Eigen::Vector3d x(0.5 * depth * uniform(random), 0.3 * depth * uniform(random), depth);
    const auto image = CalibratedCamera::project(truth.data(), intrinsics.data(), x.data());
    points.insert(points.end(), x.begin(), x.end());
    pixels.push_back(image.u + noise_px * normal(random));
    pixels.push_back(image.v + noise_px * normal(random));
    sigma.push_back(0.8 + 0.4 * std::abs(uniform(random)));
  }

  ba::PoseView view() const {
    if (!covariances.empty())
      return {CameraModelId::kCalibrated, intrinsics, points, pixels, {}, covariances};
    return {CameraModelId::kCalibrated, intrinsics, points, pixels, sigma};
  }
  ba::PoseSweep sweep(const std::vector<double>& weights,
                      const ba::PoseSweepOptions& options = {}) const {
    return ba::sweep_pose_weights(view(), constraints, 0, weights, start.data(), options);
  }
  PoseScene without(int left_out) const {
    PoseScene fewer = *this;
    const auto drop = [left_out](std::vector<double>& values, int width) {
      values.erase(values.begin() + width * left_out, values.begin() + width * (left_out + 1));
    };
    drop(fewer.points, 3);
    drop(fewer.pixels, 2);
    drop(fewer.sigma, 1);
    if (!covariances.empty()) drop(fewer.covariances, 4);
    return fewer;
  }
  // Ellipses of all directions, in place of σ.
  void give_covariances() {
    for (double s : sigma) {
      const double turn = 3.0 * s * s;
      const Eigen::Matrix2d axes = Eigen::Rotation2Dd(turn).toRotationMatrix();
      const Eigen::Matrix2d c =
          axes * Eigen::Vector2d(s * s, 0.1 * s).asDiagonal() * axes.transpose();
      covariances.insert(covariances.end(), {c(0, 0), c(0, 1), c(0, 1), c(1, 1)});
    }
  }
  Eigen::Matrix2d whitening(int j) const {
    if (covariances.empty()) return Eigen::Matrix2d::Identity() / sigma[j];
    return whitening_factor(covariances.data() + 4L * j);
  }

  std::mt19937 random;
  std::array<double, 5> intrinsics{600.0, 1.05, 310.0, 250.0, 2.0};
  std::vector<double> points, pixels, sigma, covariances;
  std::vector<ba::WeightedConstraint> constraints;
  Pose start;
};

// (r_j / √n …, λ_k e_k …): its squared norm is the cost.
inline Eigen::VectorXd stacked(const PoseScene& s,
                               const std::vector<double>& weights,
                               const Pose& pose) {
  const int n = s.view().count();
  std::vector<double> all;
  for (int j = 0; j < n; ++j) {
    const auto image =
        CalibratedCamera::project(pose.data(), s.intrinsics.data(), s.points.data() + 3L * j);
    const Eigen::Vector2d off(s.pixels[2L * j] - image.u, s.pixels[2L * j + 1] - image.v);
    for (double r : Eigen::Vector2d(s.whitening(j) * off)) all.push_back(r / std::sqrt(n));
  }
  for (std::size_t k = 0; k < s.constraints.size(); ++k) {
    const ba::WeightedConstraint& c = s.constraints[k];
    Eigen::VectorXd e(residuals::residual_size(c.constraint));
    residuals::evaluate(c.constraint, pose.data(), c.previous.data(), {e.data()});
    for (double x : e) all.push_back(weights[k] * x);
  }
  return Eigen::VectorXd::Map(all.data(), static_cast<Eigen::Index>(all.size()));
}

inline Pose moved(const Pose& pose, const Eigen::VectorXd& delta) {
  Pose result;
  plus_pose(pose.data(), delta.data(), result.data());
  return result;
}

inline double distance(const double* a, const double* b) {
  return (Eigen::Matrix<double, 12, 1>::Map(a) - Eigen::Matrix<double, 12, 1>::Map(b)).norm();
}

// Gauss–Newton on a QR factorisation of the numeric Jacobian, with halved steps.
inline Pose dense_fit(const PoseScene& s, const std::vector<double>& weights, Pose pose) {
  for (int iteration = 0; iteration < 60; ++iteration) {
    const auto at = [&](const Eigen::VectorXd& delta) {
      return stacked(s, weights, moved(pose, delta));
    };
    const Eigen::VectorXd e = stacked(s, weights, pose);
    const Eigen::MatrixXd j = numeric_jacobian(at, Eigen::VectorXd::Constant(6, 1e-4));
    Eigen::VectorXd step = j.colPivHouseholderQr().solve(-e);
    for (int half = 0; half < 20 && at(step).squaredNorm() > e.squaredNorm(); ++half) step *= 0.5;
    pose = moved(pose, step);
    if (step.norm() < 1e-13) break;
  }
  return pose;
}

inline double prediction_error(const PoseScene& s, int observation, const Pose& pose) {
  const auto image = CalibratedCamera::project(
      pose.data(), s.intrinsics.data(), s.points.data() + 3L * observation);
  const Eigen::Vector2d off(s.pixels[2L * observation] - image.u,
                            s.pixels[2L * observation + 1] - image.v);
  return (s.whitening(observation) * off).squaredNorm();
}

inline double refitted_score(const PoseScene& s, double weight, const Pose& from) {
  const int n = s.view().count();
  double sum = 0.0;
  for (int j = 0; j < n; ++j)
    sum += prediction_error(s, j, dense_fit(s.without(j), {weight}, from));
  return sum / n;
}

}  // namespace sfmcpp::support

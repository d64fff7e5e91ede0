// A linear least-squares problem of the shape of bundle adjustment, with random coefficients: the
// normal equations that methods see, and the same as a dense matrix.
#pragma once

#include <random>

#include <Eigen/Core>

#include "sfmcpp/linear/normal_equations.hpp"

namespace sfmcpp::support {

class RandomLeastSquares {
 public:
  static constexpr int kCameras = 4, kPoints = 10, kCameraSize = 6;
  static constexpr int kUnknowns = kCameras * kCameraSize + 3 * kPoints;

  explicit RandomLeastSquares(unsigned seed)
      : graph_(make_graph()), map_(make_map()), pool_(1), normal_(graph_, map_, pool_) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    jacobian_.setZero(2 * graph_.num_observations(), kUnknowns);
    residual_.resize(jacobian_.rows());
    for (double& value : residual_) value = 10.0 * normal(random);
    for (int row = 0; row < jacobian_.rows(); ++row) {
      const int a = row / 2, camera = kCameraSize * graph_.camera[a];
      const int point = kCameras * kCameraSize + 3 * graph_.point[a];
      for (int k = 0; k < kCameraSize; ++k) jacobian_(row, camera + k) = normal(random) * (1 << k);
      for (int k = 0; k < 3; ++k) jacobian_(row, point + k) = normal(random);
    }
    fill();
  }

  const linear::NormalEquations& normal() const { return normal_; }
  const Eigen::MatrixXd& jacobian() const { return jacobian_; }
  const Eigen::VectorXd& residual() const { return residual_; }
  double cost() const { return 0.5 * residual_.squaredNorm(); }

  static Eigen::VectorXd flatten(const linear::Step& step) {
    Eigen::VectorXd flat(kUnknowns);
    std::copy(step.camera.begin(), step.camera.end(), flat.begin());
    std::copy(step.point.begin(), step.point.end(), flat.begin() + kCameras * kCameraSize);
    return flat;
  }

  // What accepting the step does: the residual of the new place, with the same Jacobian.
  void move(const linear::Step& step) {
    residual_ -= jacobian_ * flatten(step);
    fill();
  }

 private:
  static linear::ObservationGraph make_graph() {
    std::vector<int> cameras, points;
    for (int k = 0; k < kCameras * kPoints; ++k) {
      cameras.push_back(k / kPoints);
      points.push_back(k % kPoints);
    }
    return linear::make_observation_graph(kCameras, kPoints, cameras, points);
  }

  static linear::ParameterMap make_map() {
    linear::ParameterMap map;
    map.camera_size = kCameraSize;
    map.num_columns = kCameras * kCameraSize;
    for (int k = 0; k < map.num_columns; ++k) {
      map.column.push_back(k);
      map.block_of.push_back(k / kCameraSize);
    }
    for (int i = 0; i <= kCameras; ++i) map.block_begin.push_back(kCameraSize * i);
    map.free_point.assign(kPoints, 1);
    return map;
  }

  void fill() {
    for (int a = 0; a < graph_.num_observations(); ++a) {
      double* j = normal_.camera_jacobian(a);
      for (int row = 0; row < 2; ++row) {
        auto& [by_point, residual] = normal_.point_record(a).row[row];
        const auto values = jacobian_.row(2 * a + row);
        for (int k = 0; k < kCameraSize; ++k) {
          j[kCameraSize * row + k] = values[kCameraSize * graph_.camera[a] + k];
        }
        for (int k = 0; k < 3; ++k) {
          by_point[k] = values[kCameras * kCameraSize + 3 * graph_.point[a] + k];
        }
        residual = residual_[2 * a + row];
      }
    }
    for (std::size_t c = 0; c < graph_.chunks.size(); ++c) normal_.accumulate(static_cast<int>(c));
    normal_.finish();
  }

  linear::ObservationGraph graph_;
  linear::ParameterMap map_;
  ThreadPool pool_;
  linear::NormalEquations normal_;
  Eigen::MatrixXd jacobian_;
  Eigen::VectorXd residual_;
};

}  // namespace sfmcpp::support

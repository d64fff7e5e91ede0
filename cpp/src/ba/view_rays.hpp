// The rays through the observations of a point, and the place closest to them.
#pragma once

#include <array>

#include <Eigen/Dense>

#include "sfmcpp/ba/image_residuals.hpp"
#include "sfmcpp/cameras/camera_concept.hpp"
#include "sfmcpp/cameras/matrix34.hpp"

namespace sfmcpp::ba {

// From the centre of a camera; its depth grows by one along it.
struct Ray {
  Eigen::Vector3d from, along;
};

// Through the pixel of an observation, as the cameras of a state see it. `Camera` is metric.
template <class Camera>
Ray ray_of(const ImageResiduals& images, const optim::State& state, int observation) {
  static constexpr std::array<double, 32> kNoChange{};
  const Problem& problem = images.problem();
  const int camera = images.graph().camera[observation];
  const double* pose = state.cameras.data() + problem.camera_offset(camera);
  const double* intrinsics = state.intrinsics.data() + problem.intrinsics_offset(camera);
  double u, v;
  Camera::undistort(intrinsics, images.u()[observation], images.v()[observation], u, v);
  MatrixAndChange projection;
  Camera::matrix(pose, intrinsics, kNoChange.data(), kNoChange.data(), projection);
  const Eigen::Map<const Matrix34> matrix(projection.matrix);
  return {{pose[3], pose[7], pose[11]},
          matrix.template leftCols<3>().inverse() * Eigen::Vector3d(u, v, 1.0)};
}

// The place with the least weighted sum of squared distances from rays; anywhere, or no number,
// where all are parallel.
class ClosestPlace {
 public:
  void add(const Ray& ray, double weight) {
    const Eigen::Vector3d along = ray.along.normalized();
    const Eigen::Matrix3d across =
        weight * (Eigen::Matrix3d::Identity() - along * along.transpose());
    sum_ += across;
    rhs_ += across * ray.from;
  }

  Eigen::Vector3d place() const { return sum_.ldlt().solve(rhs_); }

 private:
  Eigen::Matrix3d sum_ = Eigen::Matrix3d::Zero();
  Eigen::Vector3d rhs_ = Eigen::Vector3d::Zero();
};

}  // namespace sfmcpp::ba

#include "sfmcpp/cameras/pose.hpp"

#include "sfmcpp/cameras/matrix34.hpp"
#include "sfmcpp/math/so3.hpp"

namespace sfmcpp {

void plus_pose(const double* camera, const double* delta, double* result) {
  const PoseMatrixView pose(camera);
  const Eigen::Map<const Eigen::Vector3d> rotation_delta(delta), centre_delta(delta + 3);
  PoseMatrix moved;
  // Orthonormalising keeps R a rotation over any number of steps.
  moved.leftCols<3>() = orthonormalized(pose.leftCols<3>() * exp_so3(rotation_delta));
  moved.col(3) = pose.col(3) + centre_delta;
  Eigen::Map<PoseMatrix>{result} = moved;
}

}  // namespace sfmcpp

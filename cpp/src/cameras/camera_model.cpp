#include "sfmcpp/cameras/camera_model.hpp"

#include <Eigen/Core>

#include "sfmcpp/math/so3.hpp"

namespace sfmcpp {
namespace {

constexpr std::array<std::string_view, 12> kPerspectiveNames{
    "f", "aspect", "cx", "cy", "skew", "k1", "k2", "k3", "k4", "k5", "p1", "p2"};
constexpr std::array<std::string_view, 3> kBalNames{"f", "k1", "k2"};

using CameraMatrix = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;

}  // namespace

std::span<const std::string_view> intrinsic_names(CameraModelId model) {
  switch (model) {
    case CameraModelId::kCalibrated:
      return std::span(kPerspectiveNames).first(5);
    case CameraModelId::kPerspective:
      return kPerspectiveNames;
    case CameraModelId::kBal:
      return kBalNames;
  }
  return {};
}

bool has_free_intrinsics(CameraModelId model) { return model != CameraModelId::kCalibrated; }

void plus_pose(const double* camera, const double* delta, double* result) {
  const Eigen::Map<const CameraMatrix> pose(camera);
  const Eigen::Map<const Eigen::Vector3d> rotation_delta(delta), centre_delta(delta + 3);
  CameraMatrix moved;
  // Orthonormalising keeps R a rotation over any number of steps.
  moved.leftCols<3>() = orthonormalized(pose.leftCols<3>() * exp_so3(rotation_delta));
  moved.col(3) = pose.col(3) + centre_delta;
  Eigen::Map<CameraMatrix>{result} = moved;
}

}  // namespace sfmcpp

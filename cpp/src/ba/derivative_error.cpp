// Derivatives of functions from outside against numeric ones.
#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Core>

#include "sfmcpp/ba/check.hpp"
#include "sfmcpp/ba/check_jacobians.hpp"
#include "sfmcpp/ba/constraint_terms.hpp"
#include "sfmcpp/math/numeric_diff.hpp"

namespace sfmcpp::ba {
namespace {

using residuals::ConstrainedCameras;
using residuals::ConstraintGroup;
using residuals::ConstraintMember;
using residuals::ConstraintResidual;
using residuals::kNoCamera;
using residuals::kNoPoint;
using residuals::kNoPrevious;

// A group on cameras and points of its own: each member's previous camera, camera and point in
// turn, so that all members are moved at once. Without weights: what counts little or not at all
// may be as wrong.
class OwnCopy {
 public:
  OwnCopy(const ConstraintGroup& group, const ConstrainedCameras& given)
      : group_(group), model_(given.camera_model) {
    group_.weight = 1.0;
    for (ConstraintMember& member : group_.members) {
      member.weight = 1.0;
      member.entry_weights.clear();
      for (int* camera : {&member.previous, &member.camera}) take_camera(given, *camera);
      if (member.point == kNoPoint) continue;
      const double* point = given.points + long{kPointTangent} * member.point;
      points_.insert(points_.end(), point, point + kPointTangent);
      member.point = static_cast<int>(points_.size()) / kPointTangent - 1;
    }
  }

  // Of each member; those without have none.
  int poses() const {
    const ConstraintMember& member = group_.members[0];
    return (member.previous != kNoPrevious) + (member.camera != kNoCamera);
  }
  bool on_points() const { return !points_.empty(); }

  // Columns: those of `pose`, by the function.
  Eigen::MatrixXd analytic_by_pose(int pose) const {
    return stacked(kPoseTangent, [&](const ConstraintResidual& e) -> const std::vector<double>& {
      return pose + 1 == poses() ? e.by_camera : e.by_previous;
    });
  }
  Eigen::MatrixXd analytic_by_point() const {
    return stacked(kPointTangent, [](const ConstraintResidual& e) -> const std::vector<double>& {
      return e.by_point;
    });
  }

  Eigen::MatrixXd numeric_by_pose(int pose) {
    const std::vector<double> start = cameras_;
    const auto moved = [&](const Eigen::VectorXd& delta) {
      for (std::size_t k = pose; k < start.size() / kCameraStorage; k += poses())
        plus_camera(
            model_, &start[kCameraStorage * k], delta.data(), &cameras_[kCameraStorage * k]);
      return residuals();
    };
    Eigen::VectorXd steps = Eigen::VectorXd::Constant(kPoseTangent, kStep);
    steps.tail<3>() *= largest_coordinate();
    Eigen::MatrixXd jacobian = numeric_jacobian(moved, steps);
    cameras_ = start;
    return jacobian;
  }
  Eigen::MatrixXd numeric_by_point() {
    const std::vector<double> start = points_;
    const auto moved = [&](const Eigen::VectorXd& delta) {
      for (std::size_t k = 0; k < start.size(); ++k)
        points_[k] = start[k] + delta[static_cast<Eigen::Index>(k % kPointTangent)];
      return residuals();
    };
    const Eigen::VectorXd steps =
        Eigen::VectorXd::Constant(kPointTangent, kStep * largest_coordinate());
    Eigen::MatrixXd jacobian = numeric_jacobian(moved, steps);
    points_ = start;
    return jacobian;
  }

 private:
  static constexpr double kStep = 1e-4;

  void take_camera(const ConstrainedCameras& given, int& camera) {
    if (camera == kNoCamera) return;
    cameras_.insert(cameras_.end(), given.pose(camera), given.pose(camera) + kCameraStorage);
    camera = static_cast<int>(cameras_.size()) / kCameraStorage - 1;
  }

  // Places far away move by as much of their distance.
  double largest_coordinate() const {
    double largest = 1.0;
    for (std::size_t k = 3; k < cameras_.size(); k += 4)
      largest = std::max(largest, std::abs(cameras_[k]));
    for (double value : points_) largest = std::max(largest, std::abs(value));
    return largest;
  }

  ConstrainedCameras view() const {
    return {.camera_model = model_,
            .count = static_cast<int>(cameras_.size()) / kCameraStorage,
            .cameras = cameras_.data(),
            .num_points = static_cast<int>(points_.size()) / kPointTangent,
            .points = points_.data()};
  }

  Eigen::VectorXd residuals() const {
    std::vector<double> all;
    evaluate_all(group_, view(), nullptr, [&](std::size_t, const ConstraintResidual& e) {
      all.insert(all.end(), e.residual.begin(), e.residual.end());
    });
    return Eigen::Map<const Eigen::VectorXd>(all.data(), static_cast<Eigen::Index>(all.size()));
  }

  template <class Part>
  Eigen::MatrixXd stacked(int width, const Part& part) const {
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const residuals::ConstraintColumns columns;
    std::vector<double> all;
    evaluate_all(group_, view(), &columns, [&](std::size_t, const ConstraintResidual& e) {
      const std::vector<double>& values = part(e);
      all.insert(all.end(), values.begin(), values.end());
    });
    return Eigen::Map<const RowMajor>(
        all.data(), static_cast<Eigen::Index>(all.size()) / width, width);
  }

  ConstraintGroup group_;
  CameraModel model_;
  std::vector<double> cameras_, points_;
};

// The largest difference over the largest number; NaN passes through.
double relative_difference(const Eigen::MatrixXd& one, const Eigen::MatrixXd& other) {
  // Of an expression, too: GCC 16 takes the entries of a matrix made for it for uninitialised.
  const auto largest = [](const auto& m) {
    return m.size() == 0 ? 0.0 : m.cwiseAbs().template maxCoeff<Eigen::PropagateNaN>();
  };
  const double size = std::max(largest(one), largest(other));
  return size == 0.0 ? 0.0 : largest(one - other) / size;
}

Eigen::MatrixXd beside(const Eigen::MatrixXd& left, const Eigen::MatrixXd& right) {
  if (left.size() == 0) return right;
  Eigen::MatrixXd both(left.rows(), left.cols() + right.cols());
  both << left, right;
  return both;
}

}  // namespace

double derivative_error(const Problem& problem, const ConstraintGroup& group) {
  check_arrays(problem);
  const optim::State state = state_of(problem);
  const ConstrainedCameras cameras = constrained_cameras(problem, state);
  residuals::ConstraintSet checked;
  checked.add(group);
  checked.check(cameras);
  if (!group.function || group.members.empty()) return 0.0;
  OwnCopy copy(group, cameras);
  Eigen::MatrixXd analytic, numeric;
  for (int pose = 0; pose < copy.poses(); ++pose) {
    analytic = beside(analytic, copy.analytic_by_pose(pose));
    numeric = beside(numeric, copy.numeric_by_pose(pose));
  }
  const double by_poses = relative_difference(analytic, numeric);
  if (!copy.on_points()) return by_poses;
  const double by_points = relative_difference(copy.analytic_by_point(), copy.numeric_by_point());
  return std::isnan(by_points) ? by_points : std::max(by_poses, by_points);
}

}  // namespace sfmcpp::ba

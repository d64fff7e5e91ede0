#include "support/random_constraints.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "sfmcpp/cameras/matrix34.hpp"
#include "sfmcpp/math/so3.hpp"

namespace sfmcpp::support {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using residuals::ConstraintGroup;
using residuals::ConstraintKind;
using residuals::ConstraintMember;
using residuals::kNoPrevious;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::RowMajor>;

class Measurer {
 public:
  Measurer(const OwnedProblem& scene, ConstraintKind kind, double noise, unsigned seed)
      : scene_(scene), kind_(kind), noise_(noise), random_(seed) {}

  ConstraintMember measure(int previous, int camera) {
    ConstraintMember member;
    member.camera = camera;
    member.weight = std::uniform_real_distribution<double>(0.5, 2.0)(random_);
    if (facts_of(kind_).is_on_poses()) {
      if (facts_of(kind_).relates_two_poses()) member.previous = previous;
      measure_pose(previous, member);
    } else {
      measure_intrinsics(member);
    }
    return member;
  }

 private:
  Vector3d error() {
    return Vector3d::NullaryExpr([&] { return noise_ * normal_(random_); });
  }
  PoseMatrix pose(int i) const {
    return Eigen::Map<const PoseMatrix>(scene_.truth.cameras.data() + 12L * i);
  }

  void measure_pose(int previous, ConstraintMember& member) {
    const Matrix3d r = pose(member.camera).leftCols<3>(), rp = pose(previous).leftCols<3>();
    const Vector3d t = pose(member.camera).col(3), moved = t - pose(previous).col(3);
    const bool two = facts_of(kind_).relates_two_poses();
    member.pose.rotation = (two ? Matrix3d(rp.transpose() * r) : r) * exp_so3(error());
    member.pose.translation = (two ? moved : t) + error();
    if (kind_ == ConstraintKind::kDisplacementPose)
      member.pose.translation = rp.transpose() * moved + error();
    member.pose.distance = moved.norm() + error()[0];
    if (facts_of(kind_).compares_images()) {
      member.points.assign(scene_.points.begin(), scene_.points.begin() + 15);
      member.pose.intrinsics = {8.0, 1.02, 3.0, 2.0, 0.1};
    }
  }

  void measure_intrinsics(ConstraintMember& member) {
    const auto indices = residuals::constrained_intrinsics(kind_, scene_.camera_model);
    const int row = scene_.intrinsics_index[member.camera] * scene_.view().num_intrinsics();
    for (std::size_t k = 0; k < indices.size(); ++k)
      member.intrinsics[k] = scene_.truth.intrinsics[row + indices[k]] * (1.0 + 0.1 * error()[0]);
  }

  const OwnedProblem& scene_;
  ConstraintKind kind_;
  double noise_;
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
};

class RowAppender {
 public:
  RowAppender(const LinearizedProblem& linearized, DenseSystem& system)
      : in_(linearized), out_(system) {}

  void append(const ConstraintGroup& group, const ConstraintMember& member) {
    weight_ = std::sqrt(group.weight * member.weight);
    if (facts_of(group.kind).is_on_poses()) {
      append_pose(member);
    } else {
      append_intrinsics(group.kind, member);
    }
  }

 private:
  const double* pose(int i) const { return in_.state.cameras.data() + 12L * i; }

  long grow(const Eigen::VectorXd& e) {
    const long first = out_.residual.size();
    out_.residual.conservativeResize(first + e.size());
    out_.residual.tail(e.size()) = -weight_ * e;
    out_.jacobian.conservativeResize(first + e.size(), Eigen::NoChange);
    out_.jacobian.bottomRows(e.size()).setZero();
    return first;
  }

  void append_pose(const ConstraintMember& member) {
    residuals::PoseConstraint constraint = member.pose;
    constraint.points = member.points;
    const int size = residual_size(constraint);
    Eigen::VectorXd e(size);
    RowMajor by_pose(size, 6), by_previous(size, 6);
    const bool two = member.previous != kNoPrevious;
    evaluate(constraint,
             pose(member.camera),
             two ? pose(member.previous) : nullptr,
             {e.data(), by_pose.data(), two ? by_previous.data() : nullptr});
    const long first = grow(e);
    place(by_pose, member.camera, first);
    if (two) place(by_previous, member.previous, first);
  }

  void place(const RowMajor& jacobian, int camera, long first) {
    for (long row = 0; row < jacobian.rows(); ++row) {
      for (int k = 0; k < 6; ++k) set(first + row, camera, k, jacobian(row, k));
    }
  }

  void append_intrinsics(ConstraintKind kind, const ConstraintMember& member) {
    const auto indices = residuals::constrained_intrinsics(kind, in_.problem.camera_model);
    const long row = static_cast<long>(in_.problem.intrinsics_index[member.camera]) *
                     in_.problem.num_intrinsics();
    std::array<double, 2> values{};
    for (std::size_t k = 0; k < indices.size(); ++k)
      values[k] = in_.state.intrinsics[row + indices[k]];
    const auto e = evaluate(kind, values.data(), member.intrinsics.data());
    const long first =
        grow(Eigen::Map<const Eigen::VectorXd>(e.residual.data(), facts_of(kind).entries));
    for (std::size_t k = 0; k < indices.size(); ++k) {
      const auto& free = in_.free_intrinsics;
      const auto found = std::find(free.begin(), free.end(), indices[k]);
      if (found == free.end()) continue;
      set(first + static_cast<long>(k),
          member.camera,
          6 + static_cast<int>(found - free.begin()),
          e.by_values);
    }
  }

  void set(long row, int camera, int k, double value) {
    const int column = in_.map.columns_of(camera)[k];
    if (column >= 0) out_.jacobian(row, column) = weight_ * value;
  }

  const LinearizedProblem& in_;
  DenseSystem& out_;
  double weight_ = 1.0;
};

}  // namespace

std::vector<ConstraintKind> pose_constraint_kinds() {
  std::vector<ConstraintKind> kinds = all_constraint_kinds();
  std::erase_if(kinds, [](ConstraintKind kind) { return !facts_of(kind).is_on_poses(); });
  return kinds;
}

std::vector<ConstraintKind> all_constraint_kinds() { return all_enumerators<ConstraintKind>(); }

ConstraintGroup random_group(const OwnedProblem& scene,
                             ConstraintKind kind,
                             const std::vector<std::pair<int, int>>& cameras,
                             double noise,
                             unsigned seed) {
  Measurer measurer(scene, kind, noise, seed);
  ConstraintGroup group;
  group.name = enum_name(kind);
  group.kind = kind;
  group.weight = 3e4;
  for (const auto& [previous, camera] : cameras)
    group.members.push_back(measurer.measure(previous, camera));
  return group;
}

DenseSystem make_constrained_system(const LinearizedProblem& linearized) {
  DenseSystem system = make_dense_system(linearized);
  RowAppender appender(linearized, system);
  for (const ConstraintGroup& group : linearized.problem.constraints->groups()) {
    for (const ConstraintMember& member : group.members) appender.append(group, member);
  }
  return system;
}

}  // namespace sfmcpp::support

#include "sfmcpp/ba/gauge.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Core>
#include <Eigen/Householder>

#include "sfmcpp/ba/constraint_terms.hpp"
#include "sfmcpp/ba/free_sensors.hpp"
#include "sfmcpp/cameras/pose.hpp"
#include "sfmcpp/math/decompositions.hpp"
#include "sfmcpp/math/so3.hpp"

namespace sfmcpp::ba {
namespace {

// A similarity close to the identity: rotation ω, translation v, scale s. It moves a world point X
// by ω × X + v + s X, and turns a camera by Rᵀω in its own frame.
using Motions = Eigen::Matrix<double, Eigen::Dynamic, 7>;  // a parameter's response, per row
using Similarities = Eigen::Matrix<double, 7, 7>;
using CameraMatrix = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Size below which a response is rounding; what responds at all does so with a size of about one.
constexpr double kNegligibleResponse = 1e-6;

class GaugeChooser {
 public:
  GaugeChooser(const Problem& problem,
               const linear::ObservationGraph& graph,
               const optim::State& state,
               Exchange& exchange)
      : problem_(problem),
        graph_(graph),
        state_(state),
        frames_(problem),
        sensors_(problem, graph),
        tied_(points_tied_to_cameras(problem, graph)) {
    normalise();
    find_free_motions(exchange);
  }

  std::vector<PoseParameter> choose() {
    if (free_.cols() == 7) hold_first_pose();
    while (hold_if_it_moves(parameter_that_moves_most())) {
    }
    std::sort(held_.begin(), held_.end());
    return std::move(held_);
  }

 private:
  void hold_first_pose() {
    for (int i = 0; i < graph_.num_cameras; ++i) {
      if (!is_free(i) || !frames_.leads(i)) continue;
      for (int k = 0; k < kPoseTangent; ++k) hold_if_it_moves({i, k});
      return;
    }
  }

  bool takes_part(int i) const { return graph_.takes_part(i); }
  bool is_free(int i) const { return takes_part(i) && !problem_.is_fixed_camera(i); }

  Eigen::Map<const CameraMatrix> camera(int i) const {
    return Eigen::Map<const CameraMatrix>(state_.cameras.data() + problem_.camera_offset(i));
  }

  // Responses are compared in units of the scene: its middle is the origin, its extent one.
  void normalise() {
    int count = 0;
    for (int i = 0; i < graph_.num_cameras; ++i) {
      if (!takes_part(i)) continue;
      middle_ += camera(i).col(3);
      ++count;
    }
    middle_ /= std::max(count, 1);
    for (int i = 0; i < graph_.num_cameras; ++i) {
      if (takes_part(i)) extent_ = std::max(extent_, (camera(i).col(3) - middle_).norm());
    }
    if (extent_ == 0.0) extent_ = 1.0;
  }

  Motions response_of_position(const Eigen::Vector3d& position) const {
    const Eigen::Vector3d x = (position - middle_) / extent_;
    Motions rows(3, 7);
    rows << -skew(x), Eigen::Matrix3d::Identity(), x;
    return rows;
  }

  Motions response_of_pose(const PoseMatrix& pose) const {
    Motions rows = Motions::Zero(6, 7);
    rows.topLeftCorner<3, 3>() = pose.leftCols<3>().transpose();
    rows.bottomRows<3>() = response_of_position(pose.col(3));
    return rows;
  }
  Motions response_of_camera(int i) const { return response_of_pose(camera(i)); }
  Motions response_of_frame(int i) const {
    Motions rows = response_of_pose(frames_.pose(state_, i));
    rows.bottomRightCorner<3, 1>() += sensors_.anchor(frames_, state_, i) / extent_;
    return rows;
  }
  // Of its sensor in the rig, in units of the scene.
  Eigen::Vector3d lever_of(int i) const {
    return sensors_.lever(state_, problem_.rigs.sensor_of_camera[i]) / extent_;
  }

  // `free_` ← the motions that leave everything fixed where it is.
  void find_free_motions(Exchange& exchange) {
    Similarities held = Similarities::Zero();
    if (exchange.is_root()) add_fixed_cameras(held);
    add_fixed_points(held);
    exchange.sum({held.data(), static_cast<std::size_t>(held.size())});
    add_constraints(held);
    add_rigs(held);
    const Spectrum spectrum = symmetric_spectrum(held);
    const double negligible =
        kNegligibleResponse * kNegligibleResponse * std::max(1.0, spectrum.values[6]);
    const auto dimension = (spectrum.values.array() <= negligible).count();
    free_ = spectrum.vectors.leftCols(dimension);
  }

  void add_fixed_cameras(Similarities& held) const {
    for (int i = 0; i < graph_.num_cameras; ++i) {
      if (!takes_part(i) || is_free(i)) continue;
      const Motions rows = sensors_.camera_moves(i) ? response_of_frame(i) : response_of_camera(i);
      held += rows.transpose() * rows;
    }
  }

  void add_fixed_points(Similarities& held) const {
    for (int p = 0; p < graph_.num_points; ++p) {
      if (!problem_.is_fixed_point(p) || !tied_[p]) continue;
      const Motions rows = response_of_position(
          Eigen::Map<const Eigen::Vector3d>(state_.points.data() + problem_.point_offset(p)));
      held += rows.transpose() * rows;
    }
  }

  // A similarity that grows the world would move the sensors of a rig apart.
  void add_rigs(Similarities& held) const {
    if (!frames_.any()) return;
    for (int i = 0; i < graph_.num_cameras; ++i) {
      if (!is_free(i) || sensors_.camera_moves(i)) continue;
      held(6, 6) += lever_of(i).squaredNorm();
    }
  }

  void add_constraints(Similarities& held) const {
    if (problem_.constraints == nullptr) return;
    const residuals::ConstrainedCameras cameras = constrained_cameras(problem_, state_);
    const residuals::ConstraintColumns poses{.width = kPoseTangent, .of_intrinsics = {}};
    for (const residuals::ConstraintGroup& group : problem_.constraints->groups()) {
      if (!residuals::is_on_poses(group)) continue;
      residuals::evaluate_all(
          group, cameras, &poses, [&](std::size_t k, const residuals::ConstraintResidual& e) {
            const Motions rows = response_of_constraint(group.members[k], e);
            held += rows.transpose() * rows;
          });
    }
  }

  // In units of the change by the whole Jacobian, so that neither pixels nor weights matter.
  Motions response_of_constraint(const residuals::ConstraintMember& member,
                                 const residuals::ConstraintResidual& e) const {
    Motions rows = Motions::Zero(e.rows, 7);
    double squared_norm = 0.0;
    const auto add = [&](const std::vector<double>& values, const Motions& motion) {
      RowMajor jacobian = Eigen::Map<const RowMajor>(values.data(), e.rows, motion.rows());
      jacobian.rightCols<3>() *= extent_;
      squared_norm += jacobian.squaredNorm();
      rows += jacobian * motion;
    };
    if (member.camera != residuals::kNoCamera) add(e.by_camera, motion_of(member.camera));
    if (member.previous != residuals::kNoPrevious) add(e.by_previous, motion_of(member.previous));
    if (member.point != residuals::kNoPoint) add(e.by_point, motion_of_point(member.point));
    return squared_norm > 0.0 ? Motions(rows / std::sqrt(squared_norm)) : rows;
  }

  // Fixed cameras stay where they are: the motions that would move them are held already.
  Motions motion_of(int i) const {
    return is_free(i) ? response_of_camera(i) : Motions(Motions::Zero(6, 7));
  }

  // What no camera knows of does not move with the cameras.
  Motions motion_of_point(int p) const {
    if (problem_.is_fixed_point(p) || !tied_[p]) return Motions::Zero(kPointTangent, 7);
    return response_of_position(
        Eigen::Map<const Eigen::Vector3d>(state_.points.data() + problem_.point_offset(p)));
  }

  Eigen::RowVectorXd free_response(PoseParameter parameter) const {
    return response(parameter) * free_;
  }
  Motions response(PoseParameter parameter) const {
    const auto [camera, column] = parameter;
    if (column < kPoseTangent) return response_of_frame(camera).row(column);
    Motions row = Motions::Zero(1, 7);
    constexpr int kPlaces = kPoseTangent + 3;
    if (column >= kPlaces) row(0, 6) = lever_of(camera)[column - kPlaces];
    return row;
  }

  // Holding a parameter removes from the free motions the one that moves it.
  bool hold_if_it_moves(PoseParameter parameter) {
    if (free_.cols() == 0) return false;
    const Eigen::VectorXd response = free_response(parameter).transpose();
    if (response.norm() <= kNegligibleResponse) return false;
    held_.push_back(parameter);
    // The Householder reflection that takes the response to the first axis.
    Eigen::VectorXd essential(response.size() - 1);
    double tau = 0.0, beta = 0.0;
    response.makeHouseholder(essential, tau, beta);
    Eigen::RowVectorXd workspace(7);
    Eigen::MatrixXd turned = free_.transpose();
    turned.applyHouseholderOnTheLeft(essential, tau, workspace.data());
    free_ = turned.bottomRows(turned.rows() - 1).transpose();
    return true;
  }

  // Holding a parameter that hardly responds would be a constraint rather than a choice of gauge.
  PoseParameter parameter_that_moves_most() const {
    PoseParameter best{0, 0};
    double largest = 0.0;
    const auto look_at = [&](int camera, int first_column) {
      for (int k = first_column; k < first_column + kPoseTangent; ++k) {
        const double size = free_response({camera, k}).norm();
        if (size <= largest) continue;
        largest = size;
        best = {camera, k};
      }
    };
    for (int i = 0; i < graph_.num_cameras; ++i) {
      if (is_free(i) && frames_.leads(i)) look_at(i, 0);
    }
    for (const std::vector<int>& cameras : sensors_.cameras()) {
      if (!cameras.empty() && sensors_.camera_moves(cameras.front()))
        look_at(cameras.front(), kPoseTangent);
    }
    return best;
  }

  const Problem& problem_;
  const linear::ObservationGraph& graph_;
  const optim::State& state_;
  Frames frames_;
  FreeSensors sensors_;
  std::vector<char> tied_;
  Eigen::Vector3d middle_ = Eigen::Vector3d::Zero();
  double extent_ = 0.0;
  Eigen::MatrixXd free_;  // 7 × remaining degrees of freedom, orthonormal
  std::vector<PoseParameter> held_;
};

}  // namespace

std::vector<PoseParameter> choose_gauge(const Problem& problem,
                                        const linear::ObservationGraph& graph,
                                        const optim::State& state,
                                        Exchange& exchange) {
  return GaugeChooser(problem, graph, state, exchange).choose();
}

}  // namespace sfmcpp::ba

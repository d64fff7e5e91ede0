#include "sfmcpp/ba/gauge.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Core>
#include <Eigen/Householder>

#include "sfmcpp/ba/constraint_terms.hpp"
#include "sfmcpp/math/decompositions.hpp"
#include "world_motions.hpp"

namespace sfmcpp::ba {
namespace {

using Similarities = Eigen::Matrix<double, kSimilarities, kSimilarities>;
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
        world_(problem, graph, state),
        tied_(points_tied_to_cameras(problem, graph)) {
    find_free_motions(exchange);
  }

  const Eigen::MatrixXd& free_similarities() const { return free_; }

  std::vector<PoseParameter> choose() {
    if (graph_.num_cameras == 0) return {};
    if (free_.cols() == kSimilarities) hold_first_pose();
    while (hold_if_it_moves(parameter_that_moves_most())) {
    }
    std::sort(held_.begin(), held_.end());
    return std::move(held_);
  }

 private:
  void hold_first_pose() {
    for (int i = 0; i < graph_.num_cameras; ++i) {
      if (!is_free(i) || !world_.frames().leads(i)) continue;
      for (int k = 0; k < kPoseTangent; ++k) hold_if_it_moves({i, k});
      return;
    }
  }

  bool takes_part(int i) const { return graph_.takes_part(i); }
  bool is_free(int i) const { return takes_part(i) && !problem_.is_fixed_camera(i); }

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
      const PoseMotion rows =
          world_.sensors().camera_moves(i) ? world_.of_frame(i) : world_.of_camera(i);
      held += rows.transpose() * rows;
    }
  }

  void add_fixed_points(Similarities& held) const {
    for (int p = 0; p < graph_.num_points; ++p) {
      if (!problem_.is_fixed_point(p) || !tied_[p]) continue;
      const PointMotion rows = world_.of_point(p);
      held += rows.transpose() * rows;
    }
  }

  // A similarity that grows the world would move the sensors of a rig apart.
  void add_rigs(Similarities& held) const {
    if (!world_.frames().any()) return;
    for (int i = 0; i < graph_.num_cameras; ++i) {
      if (!is_free(i) || world_.sensors().camera_moves(i)) continue;
      held(6, 6) += world_.lever(i).squaredNorm();
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
            const RowMajor rows = response_of_constraint(group.members[k], e);
            held += rows.transpose() * rows;
          });
    }
  }

  // In units of the change by the whole Jacobian, so that neither pixels nor weights matter.
  RowMajor response_of_constraint(const residuals::ConstraintMember& member,
                                  const residuals::ConstraintResidual& e) const {
    RowMajor rows = RowMajor::Zero(e.rows, kSimilarities);
    double squared_norm = 0.0;
    const auto add = [&](const std::vector<double>& values, const auto& motion) {
      RowMajor jacobian = Eigen::Map<const RowMajor>(values.data(), e.rows, motion.rows());
      jacobian.rightCols<3>() *= world_.extent();
      squared_norm += jacobian.squaredNorm();
      rows += jacobian * motion;
    };
    if (member.camera != residuals::kNoCamera) add(e.by_camera, motion_of(member.camera));
    if (member.previous != residuals::kNoPrevious) add(e.by_previous, motion_of(member.previous));
    if (member.point != residuals::kNoPoint) add(e.by_point, motion_of_tied(member.point));
    return squared_norm > 0.0 ? RowMajor(rows / std::sqrt(squared_norm)) : rows;
  }

  // Fixed cameras stay where they are: the motions that would move them are held already.
  PoseMotion motion_of(int i) const {
    return is_free(i) ? world_.of_camera(i) : PoseMotion(PoseMotion::Zero());
  }

  // What no camera knows of does not move with the cameras.
  PointMotion motion_of_tied(int p) const {
    const bool moves = !problem_.is_fixed_point(p) && tied_[p];
    return moves ? world_.of_point(p) : PointMotion(PointMotion::Zero());
  }

  Eigen::RowVectorXd free_response(PoseParameter parameter) const {
    return response(parameter) * free_;
  }
  Eigen::RowVectorXd response(PoseParameter parameter) const {
    const auto [camera, column] = parameter;
    if (column < kPoseTangent) return world_.of_frame(camera).row(column);
    Eigen::RowVectorXd row = Eigen::RowVectorXd::Zero(kSimilarities);
    constexpr int kPlaces = kPoseTangent + 3;
    if (column >= kPlaces) row[6] = world_.lever(camera)[column - kPlaces];
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
    Eigen::RowVectorXd workspace(kSimilarities);
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
      if (is_free(i) && world_.frames().leads(i)) look_at(i, 0);
    }
    for (const std::vector<int>& cameras : world_.sensors().cameras()) {
      if (!cameras.empty() && world_.sensors().camera_moves(cameras.front()))
        look_at(cameras.front(), kPoseTangent);
    }
    return best;
  }

  const Problem& problem_;
  const linear::ObservationGraph& graph_;
  const optim::State& state_;
  WorldMotions world_;
  std::vector<char> tied_;
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

Eigen::MatrixXd free_similarities(const Problem& problem,
                                  const linear::ObservationGraph& graph,
                                  const optim::State& state,
                                  Exchange& exchange) {
  return GaugeChooser(problem, graph, state, exchange).free_similarities();
}

}  // namespace sfmcpp::ba

#include "sfmcpp/linear/covisibility.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Dense>

namespace sfmcpp::linear {
namespace {

using Eigen::MatrixXd, Eigen::VectorXd;

// Steps after which the gap of a wide walk no longer changes; of narrow ones, any bound will do.
constexpr int kSteps = 8;
constexpr double kInvariant = 1e-9;  // a vector of this length is rounding
constexpr double kGoldenAngle = 2.399963229728653;
// Of a parallel task.
constexpr int kPointsOfPart = 1024, kCamerasOfPart = 8;

// D^(−1/2) A T⁻¹ Aᵀ D^(−1/2) of the incidences A, with the observations D of each camera and T of
// each point. Its largest eigenvalue is 1, of the vector √D.
class Walk {
 public:
  Walk(const ObservationGraph& graph, ThreadPool& pool, Exchange& exchange)
      : graph_(graph), pool_(pool), exchange_(exchange), at_point_(graph.num_points) {
    root_ = Eigen::Map<const VectorXd>(graph.of_camera_on_all_ranks.data(), graph.num_cameras)
                .cwiseSqrt();
    inverse_root_ = (root_.array() > 0.0).select(root_.cwiseInverse(), 0.0);
  }

  VectorXd stationary() const { return root_.normalized(); }

  VectorXd operator*(const VectorXd& x) {
    const VectorXd scaled = inverse_root_.cwiseProduct(x);
    pool_.parallel_for_parts(graph_.num_points, kPointsOfPart, [&](long begin, long end) {
      for (long p = begin; p < end; ++p) at_point_[p] = mean_at_point(static_cast<int>(p), scaled);
    });
    std::vector<CompensatedSum> sums(graph_.num_cameras);
    pool_.parallel_for_parts(graph_.num_cameras, kCamerasOfPart, [&](long begin, long end) {
      for (long i = begin; i < end; ++i) sums[i] = sum_at_camera(static_cast<int>(i));
    });
    exchange_.sum(std::span(sums));
    VectorXd result(graph_.num_cameras);
    round_sums(sums, std::span(result.data(), sums.size()));
    return inverse_root_.cwiseProduct(result);
  }

 private:
  double mean_at_point(int p, const VectorXd& x) const {
    double sum = 0.0;
    for (int k = graph_.point_begin[p]; k < graph_.point_begin[p + 1]; ++k)
      sum += x[graph_.camera[graph_.of_point[k]]];
    return sum / std::max(graph_.observations_of_point(p), 1);
  }

  CompensatedSum sum_at_camera(int i) const {
    CompensatedSum sum;
    for (int k = graph_.camera_begin[i]; k < graph_.camera_begin[i + 1]; ++k)
      sum += at_point_[graph_.point[k]];
    return sum;
  }

  const ObservationGraph& graph_;
  ThreadPool& pool_;
  Exchange& exchange_;
  VectorXd root_, inverse_root_;
  std::vector<double> at_point_;
};

// Takes off the parts along the first `count` columns.
void orthogonalize(const MatrixXd& basis, int count, VectorXd& x) {
  for (int k = 0; k < count; ++k) x -= basis.col(k).dot(x) * basis.col(k);
}

double largest_eigenvalue(const VectorXd& diagonal, const VectorXd& beside) {
  Eigen::SelfAdjointEigenSolver<MatrixXd> solver;
  solver.computeFromTridiagonal(diagonal, beside, Eigen::EigenvaluesOnly);
  return solver.eigenvalues().maxCoeff();
}

}  // namespace

double covisibility_gap(const ObservationGraph& graph,
                        ThreadPool& pool,
                        Exchange& exchange,
                        double least) {
  Walk walk(graph, pool, exchange);
  MatrixXd basis(graph.num_cameras, kSteps + 1);
  basis.col(0) = walk.stationary();
  VectorXd x(graph.num_cameras), diagonal(kSteps), beside(kSteps);
  for (int i = 0; i < graph.num_cameras; ++i)
    x[i] = basis(i, 0) * std::cos(kGoldenAngle * static_cast<double>(i));
  double gap = 1.0;
  for (int k = 0; k < kSteps && gap >= least; ++k) {
    orthogonalize(basis, k + 1, x);
    const double length = x.norm();
    if (!(length > kInvariant)) break;
    if (k > 0) beside[k - 1] = length;
    basis.col(k + 1) = x / length;
    x = walk * basis.col(k + 1);
    diagonal[k] = basis.col(k + 1).dot(x);
    gap = 1.0 - largest_eigenvalue(diagonal.head(k + 1), beside.head(k));
  }
  return std::clamp(gap, 0.0, 1.0);
}

}  // namespace sfmcpp::linear

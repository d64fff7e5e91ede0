// The linearised problem at one state: Jacobian, gradient and the blocks that do not depend on
// damping.
//
// J = [Jc Jp], kept per observation; V = Σ JpᵀJp per point; b = Jᵀ r (EQUATIONS §2), so that −b is
// the gradient of the cost. U and W are never formed. Linearise once, solve for many dampings.
// Residuals that see cameras alone add their part of JᵀJ and Jᵀr as blocks (camera_terms.hpp).
#pragma once

#include <algorithm>
#include <vector>

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/core/exchange.hpp"
#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/linear/camera_terms.hpp"
#include "sfmcpp/linear/observation_graph.hpp"
#include "sfmcpp/linear/parameter_map.hpp"
#include "sfmcpp/linear/schur_kernels.hpp"

namespace sfmcpp::linear {

// A step of the unknowns: reduced camera columns, and three numbers per point.
struct Step {
  std::vector<double> camera;
  std::vector<double> point;
};

enum class DampingMatrix { kIdentity, kDiagonal };

// λ D is added to JᵀJ, with D = I or D = diag(JᵀJ) kept away from zero.
struct Damping {
  double lambda = 0.0;
  DampingMatrix matrix = DampingMatrix::kDiagonal;

  double operator()(double diagonal_entry) const;
};

// Derivative of the cost along the cameras' and along the points' part of a step.
struct Slopes {
  double camera = 0.0;
  double point = 0.0;
};

class NormalEquations {
 public:
  // The references must outlive this object. `camera_pairs`: cameras that other residuals than
  // observations relate.
  NormalEquations(const ObservationGraph& graph,
                  const ParameterMap& map,
                  ThreadPool& pool,
                  CameraPairs camera_pairs = {},
                  Exchange& exchange = this_process());

  // Filling: first the Jacobian of every observation (kernel records, see schur_kernels.hpp) …
  double* camera_jacobian(int observation) {
    return jacobian_.data() + 2L * map_.camera_size * observation;
  }
  double* point_record(int observation) {
    return records_.data() + static_cast<long>(kPointRecord) * observation;
  }
  // … chunk by chunk, each followed by `accumulate(chunk)`, in any order, and the terms of cameras
  // alone; then `finish`.
  void accumulate(int chunk);
  CameraTerms& camera_terms() { return camera_terms_; }
  void finish();

  const ObservationGraph& graph() const { return graph_; }
  const ParameterMap& map() const { return map_; }
  ThreadPool& pool() const { return pool_; }
  Exchange& exchange() const { return exchange_; }
  const SchurKernels& kernels() const { return kernels_; }
  const CameraTerms& camera_terms() const { return camera_terms_; }

  const double* jacobian() const { return jacobian_.data(); }
  const double* records() const { return records_.data(); }
  // Lower triangle of V (v00 v10 v11 v20 v21 v22), then Jpᵀ r; zeros for a point that may not move.
  const double* point_block(int p) const {
    return point_blocks_.data() + static_cast<long>(kPointFactor) * p;
  }

  // Jcᵀ r and diag(JcᵀJc), in reduced columns, over all residuals.
  const std::vector<double>& camera_rhs() const { return camera_rhs_; }
  const std::vector<double>& camera_diagonal() const { return camera_diagonal_; }
  std::vector<double> camera_damping(const Damping& damping) const;  // λD
  double gradient_max_norm() const { return gradient_max_norm_; }
  double max_diagonal() const;

  // −bᵀδ, in its two parts.
  Slopes slopes(const Step& step) const;
  // ‖Jδ‖²: the quadratic model along the step is F + α slope + ½ α² curvature.
  double curvature(const Step& step) const;
  // What the model falls by along the whole of any step: −slope − ½ curvature.
  double model_decrease(const Step& step) const;

  // The same for the δ that solves the damped system, at no cost: ½ δᵀ (b + λ D δ).
  double predicted_decrease(const Step& step, const Damping& damping) const;

 private:
  void gather_point(int p);

  const ObservationGraph& graph_;
  const ParameterMap& map_;
  ThreadPool& pool_;
  Exchange& exchange_;
  SchurKernels kernels_;
  CameraTerms camera_terms_;
  AlignedVector<double> jacobian_;
  AlignedVector<double> records_;
  AlignedVector<double> point_blocks_;
  AlignedVector<double> chunk_sums_;  // per chunk: gradient, then diagonal, of a camera block
  std::vector<double> camera_rhs_;
  std::vector<double> camera_diagonal_;
  double gradient_max_norm_ = 0.0;
};

// Points per parallel task.
inline constexpr int kPointsPerTask = 512;
inline int num_point_tasks(int points) { return (points + kPointsPerTask - 1) / kPointsPerTask; }

// Calls f(p) for every point, in parallel.
template <class F>
void for_each_point(ThreadPool& pool, int num_points, const F& f) {
  pool.parallel_for(num_point_tasks(num_points), [&](int task) {
    const int end = std::min((task + 1) * kPointsPerTask, num_points);
    for (int p = task * kPointsPerTask; p < end; ++p) f(p);
  });
}

}  // namespace sfmcpp::linear

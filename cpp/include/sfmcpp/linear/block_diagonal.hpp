// A block for each variable block of the reduced camera system: a camera, or intrinsics that
// several share. The preconditioner of the reduced system (of S) and of gradient methods (of U).
//
// Left out are the terms of a pose with intrinsics that it shares and, in S, those between two
// cameras that share intrinsics or a constraint. What is left is a sum of blocks Jᵀ (I − G Gᵀ) J
// and of blocks Jᵀ J of residuals of cameras alone: never indefinite.
#pragma once

#include <vector>

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/linear/point_elimination.hpp"
#include "sfmcpp/linear/sum_grid.hpp"

namespace sfmcpp::linear {

class CameraBlockDiagonal {
 public:
  explicit CameraBlockDiagonal(const NormalEquations& normal);

  // The diagonal blocks of Σ Jᵀ (I − G Gᵀ) J + B, and Σ Jᵀ r̄ + b in `rhs`, with M and y of every
  // point in `factors` (schur_kernels.hpp), B and b of camera_terms.hpp. Where all factors are zero
  // this is U and Jᵀ r.
  void assemble(const PointFactor* factors, std::vector<double>& rhs) {
    form(factors);
    gather(rhs, normal_.exchange());
  }

  // The same in two parts: the block Σ Jᵀ (I − G Gᵀ) J of each camera, in panel layout, and its
  // Σ Jᵀ r̄ with what is rounded off behind it are formed, or written here by callers that form them
  // themselves; then they are gathered, as often as they are to be factored.
  void form(const PointFactor* factors);
  double* camera_block(int i) {
    return camera_blocks_.data() + static_cast<long>(map_.camera_size) * map_.camera_size * i;
  }
  double* camera_rhs(int i) { return camera_rhs_.data() + 2L * map_.camera_size * i; }
  // `ranks`: over which they are summed.
  void gather(std::vector<double>& rhs, Exchange& ranks);

  // Adds `diagonal`, one number per reduced column, and factors. A block that is not positive
  // definite is replaced by its diagonal.
  void factor(const std::vector<double>& diagonal) { factor(diagonal, all_blocks_); }
  // `out` ← blocks⁻¹ `in`.
  void solve(const std::vector<double>& in, std::vector<double>& out) const {
    solve(in, out, all_blocks_);
  }
  // The same for some variable blocks alone; other columns of `out` stay.
  void factor(const std::vector<double>& diagonal, const std::vector<int>& blocks);
  void solve(const std::vector<double>& in,
             std::vector<double>& out,
             const std::vector<int>& blocks) const;

 private:
  // T: numbers, or compensated sums where several cameras or ranks add.
  template <class T>
  void sum_cameras(bool is_root, std::vector<T>& rhs, std::vector<T>& entries) const;
  template <class T>
  void fold_block(int camera, const double* panels, Columns columns, std::vector<T>& entries) const;
  template <class F>
  void for_each(const std::vector<int>& blocks, const F& f) const;
  int size(int b) const { return map_.block_begin[b + 1] - map_.block_begin[b]; }

  const NormalEquations& normal_;
  const ParameterMap& map_;
  std::vector<int> all_blocks_;          // 0, 1, …
  std::vector<long> offset_;             // of each variable block in `blocks_`
  std::vector<double> blocks_;           // column by column; after `factor` the Cholesky factors
  SumGrid grid_;                         // where sums are to have the same bits for any ranks
  AlignedVector<double> camera_rhs_;     // per camera: a camera block, and what is rounded off
  AlignedVector<double> camera_blocks_;  // per camera, panel layout
};

// The diagonal blocks of JᵀJ alone: a block for each variable block of the reduced system (a
// camera, or intrinsics that several share), one for each point. Cheap, and all that gradient
// methods and alternation need of the normal equations.
//
// Shared intrinsics are blocks of their own and their terms with the poses are left out, and so are
// the terms between two poses. The step of the block diagonal still lowers the quadratic model
// where no residual sees more than two blocks of cameras, x and y:
// 2 ‖Jx x‖² + 2 ‖Jy y‖² ≥ ‖Jx x + Jy y‖², hence 2 blockdiag(U) − U is not indefinite. With free
// sensors of rigs residuals see three (frame, sensor, intrinsics): there it may take some damping.
class BlockJacobi {
 public:
  // The normal equations must outlive this object.
  explicit BlockJacobi(const NormalEquations& normal);

  // Factors U + λD and V + λD for what the normal equations hold now.
  void factor(const Damping& damping);

  // δ = blockdiag(U + λD, V + λD)⁻¹ g, for a gradient-like vector g of the shape of a step.
  void solve(const Step& g, Step& step) const;

  // One block Gauss–Seidel sweep on the damped system: δc = (U + λD)⁻¹ b_c with the points held
  // (resection), then δp = (V + λD)⁻¹ (b_p − Wᵀ δc) (intersection).
  void sweep(Step& step);

 private:
  const NormalEquations& normal_;
  CameraBlockDiagonal cameras_;
  PointElimination points_;
  AlignedVector<PointFactor>
      no_factors_;  // M = 0 and y = 0 of every point: cameras as if points held
  std::vector<double> camera_rhs_;
};

}  // namespace sfmcpp::linear

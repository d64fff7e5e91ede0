// The preconditioner of the iterative solver, of up to three parts.
#pragma once

#include <memory>
#include <vector>

#include "block_sparse_schur.hpp"
#include "cluster_blocks.hpp"
#include "coarse_space.hpp"
#include "sfmcpp/linear/camera_block_diagonal.hpp"
#include "sfmcpp/linear/preconditioner_kind.hpp"

namespace sfmcpp::linear {

class SchurPreconditioner {
 public:
  // `blocks` are of this rank, and `pattern` is where those of all ranks are; both null: S is not
  // formed, and Schur–Jacobi is all there can be.
  SchurPreconditioner(const NormalEquations& normal,
                      const BlockSparseSchur* blocks,
                      const CameraPattern* pattern,
                      PreconditionerKind kind);

  // To be assembled with S.
  CameraBlockDiagonal& diagonal() { return diagonal_; }
  // Adds λD and factors what was assembled.
  void factor(const std::vector<double>& damping);
  // `out` ← M⁻¹ `in`, symmetric and positive definite.
  void solve(const std::vector<double>& in, std::vector<double>& out);

  bool wants_camera_modes() const { return coarse_ != nullptr; }

 private:
  CameraBlockDiagonal diagonal_;
  std::unique_ptr<ClusterBlocks> clusters_;
  std::unique_ptr<CoarseSpace> coarse_;
};

}  // namespace sfmcpp::linear

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

// Which cameras it solves for together, before S is shared out to ranks.
struct CameraGroups {
  PreconditionerKind kind;        // not auto
  CameraNeighbours neighbours{};  // where the kind asks for them
  Aggregates clusters{};          // else each camera alone
};

// `pattern` is of all ranks; null: S is not formed, and Schur–Jacobi is all there can be.
CameraGroups group_cameras(const NormalEquations& normal,
                           const CameraPattern* pattern,
                           PreconditionerKind kind);

class SchurPreconditioner {
 public:
  // `blocks`: null where S is not formed.
  SchurPreconditioner(const NormalEquations& normal,
                      const BlockSparseSchur* blocks,
                      const CameraShares& shares,
                      const CameraGroups& groups);

  // To be assembled with S.
  CameraBlockDiagonal& diagonal() { return diagonal_; }
  // Adds λD and factors what was assembled.
  void factor(const std::vector<double>& damping);
  // `out` ← M⁻¹ `in`, symmetric and positive definite. Of several ranks each solves for the columns
  // of its own cameras, and has zeros in those of others.
  void solve(const std::vector<double>& in, std::vector<double>& out);

  bool wants_camera_modes() const { return coarse_ != nullptr; }

 private:
  void find_left();

  const ParameterMap& map_;
  CameraBlockDiagonal diagonal_;
  std::vector<int> own_, left_;  // variable blocks; those that no cluster solves for
  std::unique_ptr<ClusterBlocks> clusters_;
  std::unique_ptr<CoarseSpace> coarse_;
};

}  // namespace sfmcpp::linear

// The preconditioner of the iterative solver, of up to three parts: diagonal blocks of single
// cameras (Schur–Jacobi), blocks of whole clusters of cameras, and a coarse space
// (coarse_space.hpp).
#pragma once

#include <memory>
#include <vector>

#include "aggregates.hpp"
#include "coarse_space.hpp"
#include "schur_operator.hpp"
#include "sfmcpp/linear/block_diagonal.hpp"
#include "sfmcpp/linear/linear_solver.hpp"
#include "single_precision_cholesky.hpp"

namespace sfmcpp::linear {

// The blocks of S of whole clusters of cameras, factored (Kushal & Agarwal, CVPR 2012, with
// clusters grown to a size instead of canonical views).
class ClusterBlocks {
 public:
  // All cameras of a cluster are of one rank, which factors it.
  ClusterBlocks(const NormalEquations& normal,
                const BlockSparseSchur& schur,
                const CameraPartition& partition,
                Aggregates clusters);

  // For the blocks that are assembled now, with λD in `diagonal`.
  void factor(const std::vector<double>& diagonal);
  // The columns of `out` that belong to one camera ← blocks⁻¹ `in`, for each cluster of this rank
  // whose block is positive definite; others stay.
  void solve(const std::vector<double>& in, std::vector<double>& out) const;
  // Whether `solve` sets a column.
  bool covers(int column) const { return is_covered_[column] != 0; }

 private:
  struct Cluster {
    std::vector<int> columns;  // reduced
    SinglePrecisionCholesky factor;
    bool usable = false;
  };
  int row_of(int camera, int column) const {
    return row_[static_cast<std::size_t>(normal_.map().camera_size) * camera + column];
  }
  void number_rows();
  void assemble(int k, const std::vector<double>& diagonal, DenseCholesky& lower) const;
  template <class Value>
  void add_block(int i, int j, const Value& value, DenseCholesky& lower) const;
  void factor_cluster(int k, const std::vector<double>& diagonal);
  static void solve_cluster(const Cluster& cluster,
                            const std::vector<double>& in,
                            std::vector<double>& out);

  const NormalEquations& normal_;
  const BlockSparseSchur& schur_;
  Aggregates aggregates_;
  std::vector<int> own_;    // clusters
  std::vector<int> place_;  // of an entry of a block, row after row, in its panels
  std::vector<int> row_;    // per camera and column of its block: row in its cluster, or −1
  std::vector<Cluster> clusters_;
  std::vector<char> is_covered_;  // column
};

enum class CoarseSpaceUse { kNever, kLater, kAtOnce };

// Which cameras the preconditioner solves for together; formed before S is distributed over ranks.
struct CameraGroups {
  Aggregates clusters;        // or each camera alone
  bool are_clusters = false;  // else Schur–Jacobi
  CoarseSpaceUse coarse_space = CoarseSpaceUse::kNever;
  CameraNeighbours neighbours{};  // of clusters
};

// `pattern` is of all ranks; null: S is not formed, and Schur–Jacobi is all there can be.
CameraGroups group_cameras(const NormalEquations& normal,
                           const CameraPattern* pattern,
                           PreconditionerKind kind);

class SchurPreconditioner {
 public:
  // `blocks` and `structure`, of all ranks: null where S is not formed.
  SchurPreconditioner(const NormalEquations& normal,
                      const BlockSparseSchur* blocks,
                      const CameraPartition& partition,
                      CameraGroups groups,
                      std::shared_ptr<const ReducedStructure> structure);

  // To be assembled with S.
  CameraBlockDiagonal& diagonal() { return diagonal_; }
  // Adds λD and factors what was assembled.
  void factor(const std::vector<double>& damping);
  // `out` ← M⁻¹ `in`, symmetric and positive definite. Of several ranks each solves for the columns
  // of its own cameras, and has zeros in those of others.
  void solve(const std::vector<double>& in, std::vector<double>& out);

  // From the next `factor` on with the coarse space, if it has one.
  void take_coarse_space() { uses_coarse_ = coarse_ != nullptr; }
  bool wants_camera_modes() const { return coarse_ != nullptr; }

 private:
  void find_left();

  const ParameterMap& map_;
  CameraBlockDiagonal diagonal_;
  std::vector<int> own_, left_;  // variable blocks; those that no cluster solves for
  std::unique_ptr<ClusterBlocks> clusters_;
  std::unique_ptr<CoarseSpace> coarse_;
  bool uses_coarse_ = false;
};

}  // namespace sfmcpp::linear

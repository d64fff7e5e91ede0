// The blocks of S of whole clusters of cameras, factored (Kushal & Agarwal, CVPR 2012, with
// clusters grown to a size instead of canonical views).
#pragma once

#include <vector>

#include "aggregates.hpp"
#include "block_sparse_schur.hpp"
#include "narrow_cholesky.hpp"

namespace sfmcpp::linear {

class ClusterBlocks {
 public:
  // All cameras of a cluster are of one rank, which factors it.
  ClusterBlocks(const NormalEquations& normal,
                const BlockSparseSchur& schur,
                const CameraShares& shares,
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
    NarrowCholesky factor;
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

}  // namespace sfmcpp::linear

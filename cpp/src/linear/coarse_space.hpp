// The second level of a preconditioner: neighbourhoods of cameras that move as one.
//
// Z has, for every aggregate of cameras, the modes of world_motions.hpp as columns; the correction
// Z (Zᵀ S Z)⁻¹ Zᵀ r takes out what is smooth in an error, which blocks of single cameras cannot see
// (smoothed aggregation without the smoothing; Konolige & Brown, arXiv 2007.01941, §3). Aggregates
// meet where their cameras do: the coarse matrix is sparse and factored as S itself would be, so
// that aggregates can be small, however many cameras there are.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "aggregates.hpp"
#include "schur_operator.hpp"
#include "sfmcpp/linear/elimination_tree.hpp"
#include "sfmcpp/linear/supernodal_cholesky.hpp"
#include "sfmcpp/linear/supernodes.hpp"

namespace sfmcpp::linear {

class CoarseSpace {
 public:
  // Set up when it is first factored: many runs end before. `structure`, of all ranks: neighbours
  // are found in it then, and none are given; else null.
  CoarseSpace(const NormalEquations& normal,
              const BlockSparseSchur& schur,
              const CameraPartition& partition,
              CameraNeighbours neighbours,
              std::shared_ptr<const ReducedStructure> structure);

  // For the blocks that are assembled now, with λD in `diagonal`. Without modes, or where the
  // coarse matrix is not positive definite, the correction is zero.
  void factor(const std::vector<double>& diagonal);
  // z += Z (Zᵀ S Z)⁻¹ Zᵀ r; of several ranks each has r, and gets z, of its own cameras.
  void add_correction(const std::vector<double>& r, std::vector<double>& z);

 private:
  // Of one thread, while it adds up the rows of an aggregate.
  struct Scratch {
    std::vector<int> number;   // of an aggregate among those that the row meets
    std::vector<double> sums;  // for each of these
    std::vector<int> touched;  // of these, by a camera
    std::vector<char> is_touched;
  };
  int num_modes() const { return normal_.camera_modes().count; }
  int size() const { return normal_.map().camera_size; }
  double* z_of(int camera) { return z_.data() + static_cast<long>(size()) * num_modes() * camera; }
  const double* z_of(int camera) const {
    return z_.data() + static_cast<long>(size()) * num_modes() * camera;
  }
  void set_weights(const std::vector<double>& diagonal);
  void set_modes(int aggregate);
  void orthonormalise(int aggregate);
  void analyse();
  void set_matrix();
  void add_diagonal_block(int aggregate);
  void add_block(int row, int column, const double* block);
  double middle_of_matrix() const;
  double* block_of(int aggregate, int number);
  void add_rows(int aggregate, const std::vector<double>& diagonal, Scratch& scratch);
  template <class F>
  void for_each_member_here(int aggregate, const F& f) const;
  template <class F>
  void for_each_own_column(int camera, const F& f) const;
  template <class Sums>
  void add_row(int i, const std::vector<double>& diagonal, const Sums& sums_of) const;
  template <class Value>
  void add_product(int camera, const Value& value, double* sums) const;
  void add_to_block(int i, const double* sums, double* block) const;
  void restrict(int aggregate, const std::vector<double>& r, std::vector<double>& of_camera);
  std::span<double> coarse_of(int aggregate);
  void prolong(int aggregate, std::vector<double>& z);

  const NormalEquations& normal_;
  const BlockSparseSchur& schur_;
  const CameraPartition& partition_;
  CameraNeighbours neighbours_;  // until there are aggregates
  std::shared_ptr<const ReducedStructure> structure_;
  Aggregates aggregates_;
  std::vector<int> place_;       // of an entry of a block, row after row, in its panels
  std::vector<char> own_;        // per camera and column of its block: is it of no other camera?
  std::vector<double> weights_;  // likewise: the diagonal of S, B and λD
  AlignedVector<double> z_;      // per camera: D × modes, row-major
  BlockGraph graph_;             // of the aggregates
  Adjacency adjacency_;
  // What, with its transpose, is ZᵀSZ: of each aggregate the block with itself and those with its
  // neighbours, row-major.
  AlignedVector<double> blocks_;
  double middle_ = 0.0;  // of its sums
  Supernodes supernodes_;
  std::unique_ptr<SupernodalCholesky> cholesky_;
  bool usable_ = false;
  std::vector<Scratch> scratch_;
  std::vector<CompensatedSum> sums_;  // Zᵀ r
  std::vector<double> coarse_;        // in the order of elimination
};

}  // namespace sfmcpp::linear

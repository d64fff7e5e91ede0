// The second level of a preconditioner: neighbourhoods of cameras that move as one.
//
// Z has, for every aggregate of cameras, the modes of world_motions.hpp as columns; the correction
// Z (Zᵀ S Z)⁻¹ Zᵀ r takes out what is smooth in an error, which blocks of single cameras cannot see
// (smoothed aggregation without the smoothing; Konolige & Brown, arXiv 2007.01941, §3).
#pragma once

#include <memory>
#include <vector>

#include "aggregates.hpp"
#include "schur_operator.hpp"
#include "sfmcpp/linear/dense_cholesky.hpp"

namespace sfmcpp::linear {

class CoarseSpace {
 public:
  CoarseSpace(const NormalEquations& normal,
              const BlockSparseSchur& schur,
              const CameraPartition& partition,
              const CameraNeighbours& neighbours);

  // For the blocks that are assembled now, with λD in `diagonal`. Without modes, or where the
  // coarse matrix is not positive definite, the correction is zero.
  void factor(const std::vector<double>& diagonal);
  // z += Z (Zᵀ S Z)⁻¹ Zᵀ r; of several ranks each has r, and gets z, of its own cameras.
  void add_correction(const std::vector<double>& r, std::vector<double>& z);

 private:
  int num_modes() const { return normal_.camera_modes().count; }
  int size() const { return normal_.map().camera_size; }
  double* z_of(int camera) { return z_.data() + static_cast<long>(size()) * num_modes() * camera; }
  const double* z_of(int camera) const {
    return z_.data() + static_cast<long>(size()) * num_modes() * camera;
  }
  void set_weights(const std::vector<double>& diagonal);
  void set_modes(int aggregate);
  void orthonormalise(int aggregate);
  void set_matrix();
  double middle_of_matrix() const;
  void add_rows(int aggregate, const std::vector<double>& diagonal);
  template <class F>
  void for_each_member_here(int aggregate, const F& f) const;
  template <class F>
  void for_each_own_column(int camera, const F& f) const;
  template <class Sums>
  void add_row(int i, const std::vector<double>& diagonal, const Sums& sums_of) const;
  template <class Value>
  void add_product(int camera, const Value& value, double* sums) const;
  void add_to_matrix(int i, int row_aggregate, int column_aggregate, const double* sums);
  void restrict(int aggregate, const std::vector<double>& r);
  void prolong(int aggregate, std::vector<double>& z) const;

  const NormalEquations& normal_;
  const BlockSparseSchur& schur_;
  const CameraPartition& partition_;
  Aggregates aggregates_;
  std::vector<int> place_;       // of an entry of a block, row after row, in its panels
  std::vector<char> own_;        // per camera and column of its block: is it of no other camera?
  std::vector<double> weights_;  // likewise: the diagonal of S, B and λD
  AlignedVector<double> z_;      // per camera: D × modes, row-major
  AlignedVector<double> rows_;   // what, with its transpose, is ZᵀSZ, row-major
  double middle_ = 0.0;          // of its sums
  std::unique_ptr<DenseCholesky> cholesky_;
  bool usable_ = false;
  std::vector<CompensatedSum> sums_;  // Zᵀ r
  std::vector<double> coarse_;
};

}  // namespace sfmcpp::linear

// Block rows of the Schur complement, formed one by one and by any thread.
#pragma once

#include <vector>

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/linear/point_elimination.hpp"
#include "sfmcpp/linear/reduced_structure.hpp"
#include "sfmcpp/linear/sum_grid.hpp"

namespace sfmcpp::linear {

// Memory of the lists of so many pairs; zero where no lists are kept.
double pair_list_bytes(const SchurKernels& kernels, double pairs, double observations);

// Pairs of observations of a point, by the block of S that they add to: with them a block is summed
// in registers and written once, and what is read of a camera is read in order. Eight bytes a pair,
// kept for all steps; empty where the instruction set has too few registers, or where tracks are
// long and there are far more pairs than observations: then they are listed a part of a row at a
// time, in every step.
class PairLists {
 public:
  PairLists(const NormalEquations& normal, const CameraPattern& pattern);

  bool empty() const { return pairs_.empty(); }
  const ObservationPair* pairs() const { return pairs_.data(); }
  // Where the pairs of each block of a row begin, the diagonal one left out, and the end.
  const long* begin_of_row(long first_block) const { return begin_.data() + first_block + 1; }

 private:
  AlignedVector<ObservationPair> pairs_;
  std::vector<long> begin_;  // of each block of the pattern, and the end
};

class SchurRows {
 public:
  // The references must outlive this object.
  SchurRows(const NormalEquations& normal,
            const PointElimination& elimination,
            const CameraPattern& pattern);

  // From now on sums are taken on this grid, and that of the right-hand side is compensated: what
  // is rounded off comes behind it. `grid` must outlive this object.
  void sum_on(const SumGrid& grid) { grid_ = &grid; }
  // Block (i, i), the blocks (i, j), j > i, of the pattern one after the other, and Σ Jᵀ r̄ of
  // camera i, all overwritten, for the factors that the elimination holds.
  void form(int i, int worker, double* diagonal, double* blocks, double* rhs);
  // For the row that the worker formed last: number of block (i, j) among `blocks`; −1 for i.
  const int* block_of_camera(int worker) const { return scratch_[worker].block_of_camera.data(); }

 private:
  struct FoundPair {
    int block;
    ObservationPair pair;
  };
  struct Scratch {
    std::vector<int> block_of_camera;
    AlignedVector<double> whitened;
    // Of a part of a row: as they are found, and by block.
    std::vector<FoundPair> found;
    std::vector<ObservationPair> pairs;
    std::vector<long> pair_begin;
  };

  int num_blocks_behind(int i) const;
  void add_row(int i, const Scratch& scratch, double* blocks) const;
  void lift(int i, double sign, double* blocks) const;
  void add_kept_pairs(int i, Scratch& scratch, double* blocks) const;
  void add_pairs_in_parts(int i, Scratch& scratch, double* blocks) const;
  int find_part(int begin, int last, Scratch& scratch) const;
  static void sort_part(int num_blocks, Scratch& scratch);
  // With all that is alike for all parts.
  void add_pairs(int i, PairSums sums, Scratch& scratch) const;

  const NormalEquations& normal_;
  const PointElimination& elimination_;
  const CameraPattern& pattern_;
  const SumGrid* grid_ = nullptr;
  PairLists pairs_;
  std::vector<Scratch> scratch_;
};

}  // namespace sfmcpp::linear

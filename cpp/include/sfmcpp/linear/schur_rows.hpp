// Block rows of the Schur complement, formed a few at a time and by any thread.
#pragma once

#include <array>
#include <span>
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
  // Where a row goes, all overwritten: block (i, i), the blocks (i, j), j > i, of the pattern one
  // after the other, and Σ Jᵀ r̄ of camera i.
  struct Place {
    double* diagonal;
    double* blocks;
    double* rhs;
  };
  static constexpr int kMostRows = 8;

  // The references must outlive this object.
  SchurRows(const NormalEquations& normal,
            const PointElimination& elimination,
            const CameraPattern& pattern);

  // From now on sums are taken on this grid, and that of the right-hand side is compensated: what
  // is rounded off comes behind it. `grid` must outlive this object.
  void sum_on(const SumGrid& grid) { grid_ = &grid; }
  // How many rows are best formed together. Where tracks are long, the observations of later
  // cameras do not fit into the caches, and rows of cameras that see the same points read the same
  // ones, once for all of them.
  int rows_at_once() const { return sums_in_parts_ ? kMostRows : 1; }
  // Rows of at most kMostRows cameras, for the factors that the elimination holds.
  void form(std::span<const int> cameras, std::span<const Place> places, int worker);
  // For row k of those that the worker formed last: number of block (i, j) among `blocks`; −1 for
  // i.
  const int* block_of_camera(int worker, int k) const {
    return scratch_[worker].rows[k].block_of_camera.data();
  }

 private:
  struct Row {
    int camera;
    double* blocks;
    std::vector<int> block_of_camera;
    int next = 0;  // of its observations, the first that is in no part yet
  };
  struct FoundPair {
    int key;  // numbers of its column and row
    ObservationPair pair;
  };
  struct Scratch {
    std::array<Row, kMostRows> rows;
    AlignedVector<double> whitened;
    std::vector<PairSums::Row> sums_of_rows;
    std::vector<PairSums::Block> sums_of_blocks;
    // Of a part of rows: as they are found, and by block.
    std::vector<FoundPair> found;
    std::vector<ObservationPair> pairs;
    std::vector<long> pair_begin;
    std::vector<int> columns, number_of_column;  // the latter of each camera; −1
  };

  // Numbers of a block.
  long area() const {
    return static_cast<long>(normal_.map().camera_size) * normal_.map().camera_size;
  }
  int num_blocks_behind(int i) const;
  void form_diagonal(int i, const Place& place) const;
  void add_row(const Row& row) const;
  void lift(const Row& row, double sign) const;
  void add_kept_pairs(Scratch& scratch) const;
  void add_pairs_in_parts(int num_rows, Scratch& scratch) const;
  void number_columns(int num_rows, Scratch& scratch) const;
  bool find_part(int num_rows, Scratch& scratch) const;
  void sort_part(int num_rows, Scratch& scratch) const;
  PairSums::Row sum_of_row(const Row& row, int begin, int end, double* whitened) const;
  void sum_pairs(const ObservationPair* pairs, const Scratch& scratch) const;

  const NormalEquations& normal_;
  const PointElimination& elimination_;
  const CameraPattern& pattern_;
  const SumGrid* grid_ = nullptr;
  PairLists pairs_;
  bool sums_in_parts_;
  std::vector<Scratch> scratch_;
};

}  // namespace sfmcpp::linear

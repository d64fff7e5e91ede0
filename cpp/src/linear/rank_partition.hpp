// How the iterative solver divides its work among ranks (core/exchange.hpp): which rank owns a
// camera, and vectors of the reduced system of which each rank holds the columns of its own
// cameras.
#pragma once

#include <vector>

#include "aggregates.hpp"
#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/linear/vector_algebra.hpp"

namespace sfmcpp::linear {

// The owner of a camera has its row of S, and its columns in the vectors of conjugate gradients.
class CameraPartition {
 public:
  // Cameras of an aggregate go to one rank. `work`: of each camera, the same on all ranks.
  CameraPartition(const NormalEquations& normal,
                  const Aggregates& together,
                  const std::vector<double>& work);

  int owner(int camera) const { return owner_[camera]; }
  bool is_own(int camera) const { return owner_[camera] == rank_; }
  bool are_all_own() const { return num_ranks_ == 1; }
  // The rank of each reduced column: of its camera, of several the first.
  std::vector<int> owners_of_columns(const ParameterMap& map) const;

 private:
  int rank_, num_ranks_;
  std::vector<int> owner_;
};

// A vector of the reduced system distributed over the ranks: each holds the entries of the columns
// it owns, one after the other, and exchanges with the others those of columns that rows of several
// ranks touch ("ghost" columns in the terms of distributed sparse matrices).
class ColumnPartition {
 public:
  // `touched`: whether this rank reads or adds to columns of each camera. A column that cameras
  // share belongs to the rank of the first. By all ranks.
  ColumnPartition(const NormalEquations& normal,
                  const CameraPartition& cameras,
                  const std::vector<char>& touched);

  bool is_own(std::size_t column) const { return owner_[column] == exchange_.rank(); }
  // The numbers of own columns out of all, and back.
  void take(const Vector& whole, Vector& own) const;
  void place(const Vector& own, Vector& whole) const;
  // Those of all ranks; whole on each.
  void gather(const Vector& own, Vector& whole) const;
  // Of all columns, those of this rank and those it touches. What is given lasts until the next.
  const Vector& with_ghosts(const Vector& own);
  // The numbers of own columns, each the sum over the ranks that touch it; `whole` is used up.
  void sum_ghosts(Vector& whole, Vector& own);
  // The same of compensated sums, rounded.
  void sum_ghosts(std::vector<CompensatedSum>& whole, Vector& own);

 private:
  void find_ghosts(const std::vector<char>& is_needed);
  void add_ghosts(std::vector<CompensatedSum>& whole);
  bool is_only_rank() const { return exchange_.num_ranks() == 1; }

  Exchange& exchange_;
  std::vector<int> owner_;                  // of each column
  std::vector<int> own_;                    // ascending
  std::vector<int> ghosts_, sent_columns_;  // columns of other ranks that this one touches, rank
                                            // after rank; columns of this one that others do
  std::vector<int> ghost_counts_, sent_counts_;
  Vector sent_, received_, whole_;
};

}  // namespace sfmcpp::linear

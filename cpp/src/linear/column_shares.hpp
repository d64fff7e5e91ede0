// A vector of the reduced system cut over ranks (core/exchange.hpp): each has the numbers of its
// own columns one after the other, and passes on those that the rows of others need.
#pragma once

#include <vector>

#include "camera_shares.hpp"
#include "sfmcpp/linear/vector_algebra.hpp"

namespace sfmcpp::linear {

class ColumnShares {
 public:
  // `touched`: whether this rank reads or adds to columns of each camera. A column that cameras
  // share belongs to the rank of the first. By all ranks.
  ColumnShares(const NormalEquations& normal,
               const CameraShares& cameras,
               const std::vector<char>& touched);

  bool is_own(std::size_t column) const { return owner_[column] == exchange_.rank(); }
  // The numbers of own columns out of all, and back.
  void take(const Vector& whole, Vector& own) const;
  void place(const Vector& own, Vector& whole) const;
  // Those of all ranks; whole on each.
  void gather(const Vector& own, Vector& whole) const;
  // Of all columns, those of this rank and those it touches. What is given lasts until the next.
  const Vector& spread(const Vector& own);
  // The numbers of own columns, each the sum over the ranks that touch it; `whole` is used up.
  void collect(Vector& whole, Vector& own);

 private:
  void ask_for(const std::vector<char>& is_needed);
  bool is_alone() const { return exchange_.num_ranks() == 1; }

  Exchange& exchange_;
  std::vector<int> owner_;           // of each column
  std::vector<int> own_;             // ascending
  std::vector<int> asked_, wanted_;  // columns of other ranks that this one touches, rank after
                                     // rank; columns of this one that others do
  std::vector<int> asked_counts_, wanted_counts_;
  Vector sent_, received_, whole_;
};

}  // namespace sfmcpp::linear

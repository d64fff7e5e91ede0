// Cameras shared out to ranks (core/exchange.hpp): each has the rows of S of its own, and the
// numbers of their columns in vectors of conjugate gradients.
#pragma once

#include <vector>

#include "aggregates.hpp"
#include "sfmcpp/linear/normal_equations.hpp"

namespace sfmcpp::linear {

class CameraShares {
 public:
  // Cameras of an aggregate go to one rank. `work`: of each camera, the same on all ranks.
  CameraShares(const NormalEquations& normal,
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

}  // namespace sfmcpp::linear

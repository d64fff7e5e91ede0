// (S + B + λD) x for vectors cut over ranks: each multiplies with what its operator has, and what
// that adds to columns of others goes to these.
#pragma once

#include <vector>

#include "column_shares.hpp"
#include "schur_operator.hpp"

namespace sfmcpp::linear {

class SharedProduct {
 public:
  // The references must outlive this object. By all ranks, as is `apply`.
  SharedProduct(const NormalEquations& normal, SchurOperator& schur, const CameraShares& shares);

  SchurOperator& schur() { return schur_; }
  const ColumnShares& columns() const { return columns_; }
  // With λD in `diagonal`, of all columns.
  void apply(const Vector& diagonal, const Vector& x, Vector& out);

 private:
  const NormalEquations& normal_;
  SchurOperator& schur_;
  std::vector<char> is_own_;  // camera
  ColumnShares columns_;
  Vector whole_;
};

}  // namespace sfmcpp::linear
